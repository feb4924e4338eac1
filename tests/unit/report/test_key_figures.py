"""The check of the numbers on cards, which looks at every page that a test makes."""

import pytest

from motord.report.html import Page
from tests.support.key_figures import check_cards


@pytest.mark.parametrize(
    "card",
    [
        ("1.20 +- 0.10 %", "mean, 95 %"),
        ("1.20 % (interval not known)", "mean, 95 %"),
        ("(1.20 +- 0.10) e-3", "inertia"),
        ("-3 %", "of the true torque"),
        ("valid", "calibration abc"),
    ],
)
def test_a_number_with_its_interval_or_a_reason_passes(card: tuple[str, str]) -> None:
    check_cards([card])


@pytest.mark.parametrize("value", ["1.20 %", "-1.2 %", "(1.2) e-3", "\u22121.2 %"])
def test_a_number_alone_does_not_on_any_page(value: str) -> None:
    with pytest.raises(AssertionError, match="no interval"):
        Page("").cards([(value, "mean, 95 %")])
