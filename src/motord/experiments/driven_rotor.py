"""Driven operating points of recordings, motord's own or from elsewhere, and what was not used."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from motord.experiments.subject import AnalysisError, require_columns
from motord.findings import Finding, listed
from motord.identification.operating_points import CURRENTS, PointData, good_points
from motord.identification.rotor.left_out import PART, LeftOut
from motord.recording.reader import Run, bounds_of

ANGLE = ("encoder_count", "angle_rad")
"""Either gives the angle of the rotor."""

LEFT_OUT_SHARE = 0.1
"""Part of the recordings that may be left out, besides parts of a turn, without a finding."""


def driven_points(runs: Iterable[Run], names: Sequence[str]) -> Iterator[PointData]:
    """Yield the driven operating points of good quality of the runs.

    names: columns that hold what is measured. A run made elsewhere may have no operating points,
    or such as are not of a driven rotor: then its speed is not known, 0. Raises AnalysisError.
    """
    for run in runs:
        columns = _columns(run, names)
        recorded = run.operating_points()
        points: list[Mapping[str, Any] | None] = [*good_points(recorded)]
        if not points and any(point.get("driven") for point in recorded):
            raise AnalysisError(f"{run.path}: none of its operating points is of good quality")
        for point in points or [None]:
            ticks = run.ticks(columns, **(bounds_of(point) if point else {}))
            commanded = point is not None and point.get("driven")
            speed_Hz = float(point["speed_Hz"]) if point and commanded else 0.0
            yield PointData(0.0, speed_Hz, ticks, recording=run.path.name)


def _columns(run: Run, names: Sequence[str]) -> list[str]:
    require_columns(run, ("t_ns", *names))
    if not set(ANGLE) & set(run.columns):
        raise AnalysisError(f"{run.path}: the recording has neither {' nor '.join(ANGLE)}")
    wanted = ("t_ns", *ANGLE, *CURRENTS, *names, "i_age_ns")
    return [name for name in wanted if name in run.columns]


def left_out_finding(left_out: Sequence[LeftOut], used_s: float) -> Iterator[Finding]:
    """Yield a finding if much was left out; parts of a turn always are."""
    spans = [one for one in left_out if one.reason != PART]
    lost_s = sum(one.duration_s for one in spans)
    share = lost_s / max(used_s + lost_s, 1e-9)
    if share > LEFT_OUT_SHARE:
        reasons = sorted({one.reason for one in spans})
        yield Finding(
            "data-left-out", 100 * share, 100 * LEFT_OUT_SHARE, "%", "warning",
            f"{lost_s:.3g} s were not used: {', '.join(reasons)}; `left_out` lists each span",
            "drive at a steady speed for 3 turns or more in each direction",
        )  # fmt: skip


def left_out_lines(left_out: Sequence[LeftOut]) -> Iterator[str]:
    """Yield what was left out, a line for each reason."""
    for reason in sorted({one.reason for one in left_out}):
        spans = [one for one in left_out if one.reason == reason]
        where = listed([f"{one.begin_s:.1f}-{one.end_s:.1f} s" for one in spans])
        seconds = sum(one.duration_s for one in spans)
        yield f"left out, {reason}: {seconds:.1f} s ({where})"
