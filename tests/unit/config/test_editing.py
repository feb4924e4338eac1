"""Values written into the text of a bench file."""

import tomllib

import pytest

from motord.config import ConfigError, load, packaged
from motord.config.text.editing import with_table, with_values

TEXT = """\
# a bench
[motor]  # the motor
name = "m"   # kept
encoder_direction = 1 # -1 if it counts backwards
back_emf = [
    {order = 1, amplitude_V_s_per_rad = 0.2},
]

[limits]
encoder_direction = 5
"""


def test_keys_are_replaced_where_they_are_and_others_added_under_the_head() -> None:
    values = {"encoder_direction": -1, "phase_order": "acb", "encoder_offset_rad": -1e-05}
    edited = with_values(TEXT, "motor", values, "bench.toml")
    assert edited.splitlines() == [
        "# a bench",
        "[motor]  # the motor",
        'phase_order = "acb"',
        "encoder_offset_rad = -1e-05",
        'name = "m"   # kept',
        "encoder_direction = -1  # -1 if it counts backwards",
        *TEXT.splitlines()[4:],
    ]
    assert with_values(edited, "motor", values, "bench.toml") == edited


def test_the_packaged_bench_can_be_edited(tmp_path) -> None:
    text = packaged("sim.toml").read_text().replace('"report', '"package:report')
    path = tmp_path / "bench.toml"
    path.write_text(with_values(text, "motor", {"encoder_offset_rad": 1.25}, "x"))
    assert load(path).motor.encoder_offset_rad == 1.25


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[limits]\n", r"^b.toml: there is no table \[motor\]"),
        ("motor = {name = 'm'}\n", r"no table \[motor\]"),
        ("[motor\n", r"no table \[motor\]"),
        ("[motor]\nencoder_direction = [\n1]\n", r"cannot be changed safely; write into \[motor\]"),
        ('[motor]\nname = """\nencoder_direction = 1\n"""\n', "encoder_direction = -1"),
    ],
)
def test_a_text_that_cannot_be_edited_is_refused(text: str, expected: str) -> None:
    with pytest.raises(ConfigError, match=expected):
        with_values(text, "motor", {"encoder_direction": -1}, "b.toml")


def test_the_last_table_can_be_added_to() -> None:
    assert with_values("[motor]", "motor", {"counts": 7}, "b.toml") == "[motor]\ncounts = 7\n"


def test_a_table_that_is_missing_is_added_at_the_end() -> None:
    added = with_table(TEXT, "accuracy")
    assert added == f"{TEXT}\n[accuracy]\n"
    assert with_table(added, "accuracy") == added
    assert with_table("# [accuracy]\n", "accuracy") == "# [accuracy]\n\n[accuracy]\n"


def test_what_comes_after_a_table_is_not_its_own() -> None:
    text = "[motor]\n[[motor.more]]\nencoder_direction = 3\n"
    edited = with_values(text, "motor", {"encoder_direction": -1}, "b.toml")
    assert tomllib.loads(edited)["motor"]["encoder_direction"] == -1
