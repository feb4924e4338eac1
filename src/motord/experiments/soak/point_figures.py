"""Captured points of a soak with the figures of their ticks."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.ripple_findings import is_hidden
from motord.experiments.soak import NAME
from motord.experiments.soak.point_ripples import (
    capture_label,
    noise_rms_Nm,
    point_ripples,
    set_point_label,
    without_orders,
)
from motord.experiments.subject import AnalysisError, Subject
from motord.identification import CaptureError
from motord.identification.operating_points import good_points
from motord.identification.point_ripple import PointRipple
from motord.identification.signal_condition import recorded, require_change
from motord.identification.turning import NoWholeTurn
from motord.recording.reader import Run, bounds_of
from motord.schema import rows_of

COLUMNS = ("t_ns", "plan_point", "speed_rad_s", "torque_Nm", "missed", "temperature_C")


@dataclass(frozen=True)
class PointFigures:
    """A captured point: which of the inner plan's, its label, and the figures of its ticks.

    figures: by name with its unit; not finite where they are not known in this repetition, without
    those that are stated of the set-point in none;
    ripple: without its orders, None where there is none. left_out: the capture cannot be used, and
    no figure of its torque is known.
    """

    run: str
    repetition: int
    place: int
    label: str
    torque_set_Nm: float
    t_ns: float
    missed: float
    figures: Mapping[str, float]
    channels: Mapping[str, float]
    ripple: PointRipple | None
    left_out: bool = False


def with_stated(points: Sequence[PointFigures]) -> list[PointFigures]:
    """Return the points with the figures that are stated of their set-points.

    Those that are known in no repetition are not: the others' mean would not be known, either. Nor
    is an RMS error that noise hides at any time. It comes out as 0 there, or as what noise made of
    it: its slope would be none of the ripple's.
    """
    known = {(one.place, k) for one in points for k, v in one.figures.items() if np.isfinite(v)}
    known -= {
        (one.place, "rms_error_percent")
        for one in points
        if one.ripple is not None and is_hidden(one.ripple)
    }
    return [
        replace(one, figures={k: v for k, v in one.figures.items() if (one.place, k) in known})
        for one in points
    ]


def points_of(run: Run, subject: Subject, left_out: CapturesLeftOut) -> Iterator[PointFigures]:
    """Yield the good points of a recording with their figures. Raises AnalysisError."""
    if missing := [name for name in COLUMNS if name not in run.columns]:
        raise AnalysisError(
            f"{run.path}: ticks have no {', '.join(missing)}; record the {NAME} with this version"
        )
    numbered = [one for one in run.operating_points() if {"repetition", "inner_index"} <= {*one}]
    channels = {name: run.channel(name) for name in run.channels()}
    for _, group in groupby(good_points(numbered), key=lambda point: int(point["repetition"])):
        points = list(group)
        ripples = point_ripples(run, points, subject)
        for point in points:
            ticks = run.ticks(COLUMNS, **bounds_of(point))
            ticks = rows_of(ticks, ticks["plan_point"] == int(point["index"]))
            with left_out.noted(*_capture(run, point)):
                if not ticks.size:
                    raise CaptureError("the recording has no ticks of it")
            if ticks.size:
                yield _point(
                    run, point, ticks, subject, channels, ripples.get(int(point["index"])), left_out
                )


def _point(
    run: Run,
    point: Mapping[str, Any],
    ticks: np.ndarray,
    subject: Subject,
    channels: Mapping[str, tuple[np.ndarray, np.ndarray]],
    found: PointRipple | CaptureError | None,
    left_out: CapturesLeftOut,
) -> PointFigures:
    span_ns = int(ticks["t_ns"][0]), int(ticks["t_ns"][-1])
    mean_Nm, (label, _) = np.nan, (capture := _capture(run, point))
    with left_out.noted(*capture):
        if not isinstance(found, CaptureError) or isinstance(found, NoWholeTurn):
            mean_Nm = _mean_torque_Nm(ticks, label)
        if isinstance(found, CaptureError):
            raise found
    ripple = found if isinstance(found, PointRipple) else None
    return PointFigures(
        run=run.path.name,
        repetition=int(point["repetition"]),
        place=int(point["inner_index"]),
        label=set_point_label(point),
        torque_set_Nm=float(point["torque_Nm"]),
        t_ns=sum(span_ns) / 2,
        missed=float(int(ticks["missed"][-1]) - int(ticks["missed"][0])),
        figures=_figures(ticks, subject, ripple, mean_Nm),
        channels={name: _mean_within(*one, *span_ns) for name, one in channels.items()},
        ripple=None if ripple is None else without_orders(ripple),
        left_out=bool(np.isnan(mean_Nm)),
    )


def _capture(run: Run, point: Mapping[str, Any]) -> tuple[str, tuple[Path, int]]:
    """Return the label of a capture, and what no other has."""
    return capture_label(run, point), (run.path, int(point["tick_start"]))


def _mean_torque_Nm(ticks: np.ndarray, label: str) -> float:
    """Return the mean torque of a capture over its angle. Raises CaptureError without any."""
    known = rows_of(ticks, recorded(ticks["torque_Nm"], "torque_Nm", label))
    require_change({"torque_Nm": known["torque_Nm"]}, label)
    weights = np.abs(known["speed_rad_s"].astype(float))
    torque_Nm = known["torque_Nm"].astype(float)
    return float(np.average(torque_Nm, weights=weights if weights.any() else None))


def _figures(
    ticks: np.ndarray, subject: Subject, ripple: PointRipple | None, mean_Nm: float
) -> dict[str, float]:
    """Return the figures of a capture's ticks; nan where there is none."""
    in_percent = 100 / subject.motor.rated_torque_Nm
    return {
        "rms_error_percent": np.nan if ripple is None else ripple.rms_percent,
        "noise_rms_percent": np.nan if ripple is None else in_percent * noise_rms_Nm(ripple),
        "torque_mean_Nm": mean_Nm if subject.sensor.passes_mean else np.nan,
        "inverter_temperature_C": _finite_mean(ticks["temperature_C"].astype(float)),
    }


def _mean_within(t_ns: np.ndarray, values: np.ndarray, first_ns: int, last_ns: int) -> float:
    """Return the mean of a channel's readings (n,) within a span; nan where there is none."""
    return _finite_mean(values[(t_ns >= first_ns) & (t_ns <= last_ns)])


def _finite_mean(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else np.nan
