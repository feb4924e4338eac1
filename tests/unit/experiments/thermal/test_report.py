"""How the thermal constants are written."""

import pytest

from motord.experiments.thermal.report import constant_row
from motord.intervals import IntervalEstimate


@pytest.mark.parametrize(
    ("one", "written"),
    [
        (IntervalEstimate(0.6367, low=0.6266, high=0.647), ["0.637", "0.627 to 0.647"]),
        (IntervalEstimate(100.0, low=98.46, high=101.7), ["100.0", "98.5 to 101.7"]),
        (IntervalEstimate(1512.3, low=1391.0, high=1633.0), ["1512", "1391 to 1633"]),
        (IntervalEstimate(1.5, low=1.5, high=float("inf")), ["1.500", "1.5 to inf"]),
        (IntervalEstimate(1.5), ["1.500", "not known"]),
        (IntervalEstimate(3023.4), ["3023", "not known"]),
    ],
)
def test_a_constant_has_the_digits_of_its_interval(
    one: IntervalEstimate, written: list[str]
) -> None:
    assert constant_row("winding", one, "J/K") == ["winding", *written, "J/K"]
