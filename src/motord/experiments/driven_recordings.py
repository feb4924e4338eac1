"""Driven operating points of recordings, whether motord's own or from elsewhere."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from motord.experiments.subject import AnalysisError
from motord.identification.operating_points import CURRENTS, PointData, good_points
from motord.recording.reader import Run, bounds_of

ANGLE = ("encoder_count", "angle_rad")
"""Either gives the angle of the rotor."""


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
            ticks = _ticks(run, columns, point)
            commanded = point is not None and point.get("driven")
            yield PointData(0.0, float(point["speed_Hz"]) if point and commanded else 0.0, ticks)


def _columns(run: Run, names: Sequence[str]) -> list[str]:
    missing = [name for name in ("t_ns", *names) if name not in run.columns]
    if missing:
        raise AnalysisError(f"{run.path}: the recording has no {', '.join(missing)}")
    if not set(ANGLE) & set(run.columns):
        raise AnalysisError(f"{run.path}: the recording has neither {' nor '.join(ANGLE)}")
    wanted = ("t_ns", *ANGLE, *CURRENTS, *names, "i_age_ns")
    return [name for name in wanted if name in run.columns]


def _ticks(run: Run, columns: list[str], point: Mapping[str, Any] | None) -> np.ndarray:
    """Return the ticks of a point, of all the run for None. Raises AnalysisError for no ticks."""
    ticks = run.ticks(columns, **(bounds_of(point) if point else {}))
    if not ticks.size:
        raise AnalysisError(f"{run.path}: there are no ticks in an operating point")
    return ticks
