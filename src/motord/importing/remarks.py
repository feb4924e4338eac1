"""What the source did not tell and what was made of it, and what looks like a mistake: in words."""

from collections.abc import Iterator, Sequence, Set
from typing import Any

from motord.importing.problems import Problems
from motord.importing.survey import Survey
from motord.importing.times import BACK, STANDING

MANY_ROWS = 0.1
"""Share of rows with one problem from which its cause is probably in the map or the source."""

TORQUE_RATIO = 10.0
"""Torque, in parts of the rated one, that a motor hardly has."""


def on_rows(problems: Problems, seen: Survey) -> Iterator[str]:
    """Yield what is to be said of times."""
    if not seen.regular:
        yield "the rows are not evenly spaced: no missing ones are counted"
    if problems.count(STANDING) > MANY_ROWS * seen.rows:
        yield "many times repeat: where they are rounded, give period_s instead of a column"
    if problems.count(BACK) > MANY_ROWS * seen.rows:
        yield "time goes back for many rows: recordings that follow each other must be cut apart"


def on_torque(
    given: Set[str], points: Sequence[dict[str, Any]], largest_Nm: float, rated_Nm: float
) -> Iterator[str]:
    """Yield what is to be said of torque. largest_Nm: the largest that was measured."""
    if "torque_Nm" not in given:
        yield "no torque: only what needs none can be analysed"
    if largest_Nm > TORQUE_RATIO * rated_Nm:
        yield f"the torque reaches {largest_Nm:g} Nm, {rated_Nm:g} Nm is rated: is its scale right?"
    if "torque_set_Nm" not in given and points:
        yield f"torque of the operating points: {points[0]['torque_source']}"


def on_speed_and_points(given: Set[str], points: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield what is to be said of speed and operating points."""
    if not {"speed_rad_s", "speed_Hz"} & given:
        yield "speed: from angle and time"
    if not points:
        yield "no operating point: nothing turns a whole turn at constant set-points"
