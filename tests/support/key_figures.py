"""Every number on the cards of a page has its interval, or says why it has none."""

import re
from collections.abc import Sequence

from motord.intervals import NOT_KNOWN

NUMBER = re.compile(r"\(?[-+\u2212]?\d")
INTERVAL = re.compile(r"\+-|\u00b1|interval not known| to ")
WITHOUT = {
    NOT_KNOWN: "that is the reason",
    "the true torque": "the simulation itself says it",
    "predicted by errors": "the bound of its probability is next to it",
    "operating points": "they are counted",
    "encoder direction": "1 or -1",
    "serial number": "no measurement",
    "tested": "no measurement",
}
"""What cards without an interval say of their number, and why it has none."""


def check_cards(figures: Sequence[tuple[str, str]]) -> None:
    """Raise AssertionError for a number without interval and reason."""
    for value, what in figures:
        if NUMBER.match(value) and not INTERVAL.search(value) and "\u00b1" not in what:
            assert any(reason in what for reason in WITHOUT), f"no interval: {value}, {what}"
