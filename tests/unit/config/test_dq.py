"""Signal maps of drives that take d and q: what fits together, and what is said if not."""

import re
from pathlib import Path

import pytest

from motord import config
from motord.config import ConfigError

DQ = Path(__file__).parents[3] / "config" / "dq.toml"
TEXT = DQ.read_text()


def complaint(folder: Path, *changes: tuple[str, str]) -> str:
    text = TEXT
    for pattern, replacement in changes:
        text, count = re.subn(pattern, replacement, text, flags=re.MULTILINE)
        assert count == 1, pattern
    path = folder / "bench.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        config.load(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    return message


def test_the_example_is_as_it_says() -> None:
    inverter = config.load(DQ).inverter
    assert inverter.can is not None
    assert inverter.dq == config.DqConfig()
    assert inverter.can.signals.rotating
    assert not inverter.q_only


def test_q_alone(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(re.sub(r"^command_i_d_A.*\n", "", TEXT, flags=re.MULTILINE))
    assert config.load(path).inverter.q_only


PHASES = 'command_i_A = ["A.A", "A.B", "A.C"]\n'


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (((r"^command_i_q_A.*\n", ""),), "needs either command_i_A"),
        (((r"^command_i_q_A", PHASES + "command_i_q_A"),), "needs either command_i_A"),
        (((r"^command_i_q_A.*\n", PHASES),), "command_i_d_A needs command_i_q_A"),
        (((r"^command_enable_value = 9", "command_enable_value = 0"),), "must differ"),
        (((r"^feedback_i_q_A.*\n", ""),), "needs either feedback_i_A"),
        (
            ((r"^feedback_i_q_A", 'feedback_i_A = ["A.A", "A.B", "A.C"]\nfeedback_i_q_A'),),
            "needs either feedback_i_A",
        ),
        (
            ((r"^feedback_i_q_A.*\n", 'feedback_i_A = ["A.A", "A.B", "A.C"]\n'),),
            "need feedback_i_q_A",
        ),
        (((r"^feedback_u_q_V.*\n", ""),), "go together"),
        (
            ((r"^feedback_u_q_V", 'feedback_u_V = ["A.A", "A.B", "A.C"]\nfeedback_u_q_V'),),
            "not both",
        ),
        (
            ((r"^command_i_d_A.*\n", ""), (r"^command_i_q_A.*\n", PHASES)),
            "feedback_i_q_A needs command_i_q_A",
        ),
        (((r"^feedback_u_bus_V.*\n", ""),), "the interlock of the bus voltage"),
        (((r"^feedback_status.*\n", ""),), "feedback_status: missing"),
        (((r"^command_enable = .*\n", ""),), "command_enable: missing"),
        (((r'^driver = "can-dq"', 'driver = "can"'),), "takes phase currents"),
        (((r"^feedback_status", "status_ready_value = 2\nfeedback_status"),), "that status_ready"),
        (((r"^direction = 1", "direction = 0"),), "inverter.dq.direction"),
        (((r"^scale = 1.0", "scale = 0.0"),), "inverter.dq.scale"),
        (((r'^angle = "turning"', 'angle = "still"'),), "inverter.dq.angle"),
        (((r'^connection = "star"', 'connection = "independent"'),), "it takes a star"),
    ],
)
def test_what_does_not_fit_together(
    tmp_path: Path, changes: tuple[tuple[str, str], ...], expected: str
) -> None:
    assert expected in complaint(tmp_path, *changes)


def test_phase_currents_need_the_other_driver(tmp_path: Path) -> None:
    text = (DQ.parent / "emulated.toml").read_text()
    text = text.replace('driver = "can"', 'driver = "can-dq"')
    text = text.replace('connection = "independent"', 'connection = "star"')
    path = tmp_path / "bench.toml"
    path.write_text(text)
    with pytest.raises(
        ConfigError, match=r'takes currents along d and q: .*or take driver = "can"'
    ):
        config.load(path)


def test_a_drive_without_its_table(tmp_path: Path) -> None:
    text = TEXT[: TEXT.index("[inverter.can]")] + TEXT[TEXT.index("[bridge]") :]
    path = tmp_path / "bench.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r'driver = "can-dq" needs a table \[inverter.can\]'):
        config.load(path)
