"""What is wrong is said once, with keys as they are written, and without names of types."""

import re
from pathlib import Path

import pytest
from pydantic import ValidationError

from motord.config import ConfigError, load, packaged
from motord.config.base import Section
from motord.experiments.plans import build
from motord.section.complaints import complaints, wrong_things
from motord.sequencing import PlanError

BENCH = packaged("sim.toml").read_text()
A = "amplitude_V_s_per_rad"


def said(folder: Path, bench: str) -> list[str]:
    """Return what is wrong with a bench file, without the places in it."""
    path = folder / "bench.toml"
    path.write_text(bench)
    with pytest.raises(ConfigError) as refused:
        load(path)
    return [re.sub(rf"^{re.escape(str(path))}:?\d*: ", "", one) for one in refused.value.lines]


@pytest.mark.parametrize(
    ("back_emf", "wrong"),
    [
        (
            f'[{{order = 1, {A} = 0.1}}, {{order = "x", {A} = 0.1}}]',
            ["motor.back_emf[1].order: input should be a valid integer, got 'x'"],
        ),
        (
            "[{order = 1, amplitud_V_s_per_rad = 0.1}]",
            [
                f"motor.back_emf[0].{A}: missing",
                "motor.back_emf[0].amplitud_V_s_per_rad: unknown key; did you mean " + A + "?",
            ],
        ),
        ("[]", ["motor.back_emf: takes at least one value, got none"]),
        ("[3]", ["motor.back_emf[0]: is a table, {...}, got 3"]),
        ("{k_V_s_per_rad = [[1, 2]]}", ["motor.back_emf.k_V_s_per_rad[0][2]: missing"]),
        (
            "7",
            ["motor.back_emf: takes a list, [...], or is a table, [motor.back_emf], got 7"],
        ),
    ],
)
def test_of_a_choice_of_types_only_that_which_is_meant(tmp_path, back_emf, wrong):
    bench = re.sub(r"^back_emf = \[.*?^\]$", f"back_emf = {back_emf}", BENCH, flags=re.M | re.S)
    assert said(tmp_path, bench) == wrong


def test_a_table_in_place_of_a_list_is_said_to_be_one(tmp_path):
    bench = re.sub(r"^back_emf = \[.*?^\]$", "back_emf = {order = 1}", BENCH, flags=re.M | re.S)
    assert said(tmp_path, bench)[0] == "motor.back_emf: takes a list, [[motor.back_emf]]"


def test_keys_in_a_list_of_tables_of_several_types_are_suggested(tmp_path):
    channel = '\n[[channels]]\nname = "x"\nunit = "C"\nsource = {driver = "can", dbcc = "a"}\n'
    assert "channels[0].source.dbcc: unknown key; did you mean dbc?" in said(
        tmp_path, BENCH + channel
    )


class Either(Section):
    """A value of one of two plain types."""

    value: str | float


def test_names_of_plain_types_are_no_keys():
    with pytest.raises(ValidationError) as refused:
        Either.model_validate({"value": True})
    assert {item["loc"] for item in complaints(refused.value)} == {("value",)}
    assert all(line.startswith("value: Input ") for line in wrong_things(refused.value))


@pytest.mark.parametrize(
    ("settings", "wrong"),
    [
        ({"torques_Nm": [2, "a"]}, "torques_Nm[1]: Input should be a valid number, got 'a'"),
        ({"torques_Nm": [-1]}, "torques_Nm[0]: Input should be greater than 0, got -1"),
        ({"torques_Nm": []}, "torques_Nm: takes at least one value, got none"),
        ({"torques_Nm": [1.0] * 65}, "torques_Nm: takes at most 64 values, got 65"),
        ({"settle_s": [0, 5]}, "settle_s: Input should be a valid number, got [0, 5]"),
        ({"turns": "x" * 500}, "turns: Input should be a valid integer, got 'xxxxxxxxxxxx...xx"),
    ],
)
def test_a_setting_is_named_with_its_value(settings, wrong):
    with pytest.raises(PlanError) as refused:
        build("calibrate", load(), settings)
    assert str(refused.value).startswith(f"calibrate: setting {wrong}")
    assert "settings are" not in str(refused.value)


def test_settings_are_listed_for_one_that_is_none_of_them():
    with pytest.raises(PlanError, match=r"setting torque: is not known; settings are: torques_Nm,"):
        build("calibrate", load(), {"torque": 1})


def test_the_nearest_setting_or_plan_is_suggested():
    with pytest.raises(PlanError, match=r"settings are: .*; did you mean torques_Nm\?$"):
        build("calibrate", load(), {"torque_Nm": 1})
    with pytest.raises(PlanError, match=r"there are: .*; did you mean calibrate\?$"):
        build("calibrat", load())
    with pytest.raises(PlanError, match=r"settings are: .*, compensate$"):
        build("calibrate", load(), {"xyz": 1})
