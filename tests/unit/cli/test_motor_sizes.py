"""What the terminal shows of motors of a millinewton metre and of kilonewton metres."""

from pathlib import Path

import pytest

from motord.cli.bench.watch.panels import decimals
from motord.cli.record.commands import _imported_lines
from motord.experiments.ilc.order_list import Unreached
from motord.importing.convert import Imported


@pytest.mark.parametrize(("scale", "shown"), [(0.0, 3), (7e-4, 6), (0.3, 4), (6.0, 3), (5e3, 0)])
def test_watch_has_decimals_for_a_motor_of_any_size(scale: float, shown: int) -> None:
    assert decimals(scale) == shown


@pytest.mark.parametrize(
    ("torque_Nm", "text"), [(7.3e-4, " 0.00073 Nm"), (-2.5, " -2.5 Nm"), (4999.3, " 4999.3 Nm")]
)
def test_points_are_listed_with_the_digits_of_their_torque(torque_Nm: float, text: str) -> None:
    point = {
        "index": 0, "torque_Nm": torque_Nm, "speed_Hz": 1.0, "turns": 2.0, "quality": "ok",
    }  # fmt: skip
    done = Imported(Path("a.mcap"), 1, 1.0, 1.0, 0, (point,), (), ())
    assert text in list(_imported_lines(done))[1]


@pytest.mark.parametrize(("amplitude_Nm", "text"), [(4.9e-7, "0.000490 mNm"), (3.2, "3200 mNm")])
def test_amplitudes_that_are_not_learned_have_digits(amplitude_Nm: float, text: str) -> None:
    assert text in Unreached(1.0, 1.0, 48, amplitude_Nm, "room").to_text()
