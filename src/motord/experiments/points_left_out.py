"""Recorded operating points that an analysis leaves out, or a part of them, as a finding."""

from collections.abc import Iterable, Iterator

from motord.findings import Finding, listed
from motord.identification.operating_points import GOOD, good_points
from motord.recording.reader import Run


def points_left_out(runs: Iterable[Run], others: Iterable[str] = ()) -> tuple[Finding, ...]:
    """Return a finding if points were recorded of which no take is of good quality.

    others: points that are left out besides, or in part, each with the reason in brackets.
    """
    reasons = [*(sentence for run in runs for sentence in _poor(run)), *others]
    if not reasons:
        return ()
    return (
        Finding(
            "points-left-out", len(reasons), 0, "points", "warning",
            f"left out for the reason in brackets: {listed(reasons, 5)}",
            "take these points again; of counts out of range, look for a loose wire first",
        ),
    )  # fmt: skip


def _poor(run: Run) -> Iterator[str]:
    recorded = run.operating_points()
    used = {(point["index"], point.get("compensate", 0)) for point in good_points(recorded)}
    latest = {
        (point["index"], point.get("compensate", 0)): point
        for point in recorded
        if point.get("quality", GOOD) != GOOD
    }
    for key, point in latest.items():
        if key not in used:
            yield f"{point['torque_Nm']:g} Nm, {point['speed_Hz']:g} Hz ({point['quality']})"
