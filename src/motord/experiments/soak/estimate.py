"""Figures of each repetition, from recordings of a soak, and their trends."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from motord.experiments.recording_checks import points_left_out
from motord.experiments.ripple_findings import is_hidden
from motord.experiments.soak.point_ripples import (
    changed_behind_noise,
    noise_rms_Nm,
    point_ripples,
    ripple_findings,
    without_orders,
)
from motord.experiments.soak.result import FigureTrend, Repetition, SoakResult
from motord.experiments.soak.settings import NAME
from motord.experiments.soak.trend import drifting, slope
from motord.experiments.subject import AnalysisError, Recordings, Subject, check_plan
from motord.identification.operating_points import good_points
from motord.identification.point_ripple import PointRipple
from motord.identification.signal_condition import CountsOutOfRange, require_change
from motord.intervals import LEVEL
from motord.recording.reader import Run, bounds_of
from motord.schema import rows_of

COLUMNS = ("t_ns", "plan_point", "speed_rad_s", "torque_Nm", "missed", "temperature_C")

OWN_FIGURES = (
    "rms_error_percent", "noise_rms_percent", "torque_mean_Nm", "inverter_temperature_C",
    "missed_ticks",
)  # fmt: skip
"""Figures of the ticks; a channel of such a name has "channel" before it."""


OF_TORQUE = ("rms_error_percent", "noise_rms_percent", "torque_mean_Nm")
"""Figures that have the scale of the torque, those of set-points with " of " after them."""


@dataclass(frozen=True)
class PointFigures:
    """A captured point: which of the inner plan's, its label, and the figures of its ticks.

    figures: by name with its unit; not finite where they are not known in this repetition, without
    those that are stated of the set-point in none;
    ripple: without its orders, None where there is no whole turn, or counts are out of range.
    """

    run: str
    repetition: int
    place: int
    label: str
    t_ns: float
    missed: float
    figures: Mapping[str, float]
    channels: Mapping[str, float]
    ripple: PointRipple | None
    out_of_range: CountsOutOfRange | None = None


def soak_trends(recordings: Recordings) -> SoakResult:
    """Return the trends. Raises AnalysisError, IdentifyError, ConfigError, RecordError."""
    runs, subject = recordings.runs, recordings.subject
    plan = _plan_of(runs)
    taken: dict[tuple[int, int], PointFigures] = {}
    for run in sorted(runs, key=_began_ns):
        for one in _points(run, subject):
            taken[one.repetition, one.place] = one
    if not taken:
        files = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(f"{files}: no good operating point in there")
    points = _without_hidden(list(taken.values()))
    units = {name: one.unit for run in runs for name, one in run.channels().items()}
    repetitions = _repetitions(points)
    scale = subject.accuracy.torque_scale
    trends = [
        one.with_scale(scale) if one.name.partition(" of ")[0] in OF_TORQUE else one
        for one in (
            *_of_repetitions(repetitions, points, units),
            *_of_points(repetitions, points),
        )
    ]
    drifts = drifting([one.slope.p_value for one in trends], 1 - LEVEL)
    judged = tuple(replace(one, drifts=its) for one, its in zip(trends, drifts, strict=True))
    ripples = [(one.label, one.repetition, one.ripple) for one in points if one.ripple is not None]
    questionable = (
        *ripple_findings([one for *_, one in ripples]),
        *changed_behind_noise(ripples),
        *points_left_out(runs, _out_of_range(points)),
    )
    return SoakResult(plan, tuple(repetitions.values()), judged, questionable)


def _out_of_range(points: Sequence[PointFigures]) -> list[str]:
    """Return which captures have no ripple, as counts are out of range. Raises IdentifyError.

    That is so if no capture has any: the encoder is another one.
    """
    found = [(one, error) for one in points if (error := one.out_of_range)]
    if found and all(one.ripple is None for one in points):
        raise found[0][1]
    return [
        f"repetition {one.repetition}, {one.label} (encoder counts out of range: no ripple)"
        for one, _ in found
    ]


def _without_hidden(points: Sequence[PointFigures]) -> list[PointFigures]:
    """Return the points without the RMS errors of set-points where noise hides it, at any time.

    It comes out as 0 there, or as what noise made of it: its slope would be none of the ripple's.
    """
    hidden = {one.place for one in points if one.ripple is not None and is_hidden(one.ripple)}
    return [
        replace(one, figures={k: v for k, v in one.figures.items() if k != "rms_error_percent"})
        if one.place in hidden
        else one
        for one in points
    ]


def _plan_of(runs: Sequence[Run]) -> str:
    """Return the plan that was repeated. Raises AnalysisError."""
    found = []
    for run in runs:
        check_plan(run, NAME)
        plan = run.plan_metadata
        settings = plan.get("settings", {})
        identity = (plan.get("run_id", ""), settings.get("plan"), settings.get("inner"))
        found.append((run, identity))
    for run, identity in found[1:]:
        if identity != found[0][1]:
            raise AnalysisError(
                f"{run.path}: is of another soak than {found[0][0].path}; analyse each by itself, "
                "with all files of it, also of its resumption"
            )
    return str(found[0][1][1] or "")


def _began_ns(run: Run) -> int:
    return min((int(point["t_start_ns"]) for point in run.operating_points()), default=0)


def _points(run: Run, subject: Subject) -> Iterable[PointFigures]:
    """Yield the good points of a recording with their figures. Raises AnalysisError."""
    if missing := [name for name in COLUMNS if name not in run.columns]:
        raise AnalysisError(
            f"{run.path}: ticks have no {', '.join(missing)}; record the {NAME} with this version"
        )
    numbered = [one for one in run.operating_points() if {"repetition", "inner_index"} <= {*one}]
    channels = {name: run.channel(name) for name in run.channels()}
    for _, group in groupby(good_points(numbered), key=lambda point: int(point["repetition"])):
        points = list(group)
        ripples, out_of_range = point_ripples(run, points, subject)
        for point in points:
            ticks = run.ticks(COLUMNS, **bounds_of(point))
            ticks = rows_of(ticks, ticks["plan_point"] == int(point["index"]))
            if ticks.size:
                index = int(point["index"])
                ripple = ripples.get(index)
                found = _point(
                    run, point, ticks, _figures(ticks, subject, ripple), channels, ripple
                )
                yield replace(found, out_of_range=out_of_range.get(index))


def _point(
    run: Run,
    point: Mapping[str, Any],
    ticks: np.ndarray,
    figures: Mapping[str, float],
    channels: Mapping[str, tuple[np.ndarray, np.ndarray]],
    ripple: PointRipple | None,
) -> PointFigures:
    place = int(point["inner_index"])
    label = f"point {place + 1}, {point['torque_Nm']:g} Nm, {point['speed_Hz']:g} Hz"
    at = f"{run.path}: repetition {int(point['repetition'])}, {label}"
    require_change({"torque_Nm": ticks["torque_Nm"]}, at)
    span_ns = int(ticks["t_ns"][0]), int(ticks["t_ns"][-1])
    return PointFigures(
        run=run.path.name,
        repetition=int(point["repetition"]),
        place=place,
        label=label,
        t_ns=sum(span_ns) / 2,
        missed=float(int(ticks["missed"][-1]) - int(ticks["missed"][0])),
        figures=figures,
        channels={name: _mean_within(*one, *span_ns) for name, one in channels.items()},
        ripple=None if ripple is None else without_orders(ripple),
    )


def _figures(ticks: np.ndarray, subject: Subject, ripple: PointRipple | None) -> dict[str, float]:
    """Return the figures of a capture's ticks; nan where there is none."""
    torque_Nm = ticks["torque_Nm"].astype(float)
    weights = np.abs(ticks["speed_rad_s"].astype(float))
    mean_Nm = float(np.average(torque_Nm, weights=weights if weights.any() else None))
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


def _repetitions(points: Sequence[PointFigures]) -> dict[int, Repetition]:
    """Return the repetitions by number, in order; complete are those with the most points."""
    groups: dict[int, list[PointFigures]] = {}
    for one in sorted(points, key=lambda one: (one.repetition, one.place)):
        groups.setdefault(one.repetition, []).append(one)
    most = len({one.place for one in points})
    middles_ns = {key: np.mean([one.t_ns for one in group]) for key, group in groups.items()}
    first_ns = min(middles_ns.values())
    return {
        key: Repetition(
            key, group[0].run, float(middles_ns[key] - first_ns) / 3.6e12,
            len(group), len(group) == most,
        )
        for key, group in groups.items()
    }  # fmt: skip


def _of_repetitions(
    repetitions: Mapping[int, Repetition],
    points: Iterable[PointFigures],
    units: Mapping[str, str],
) -> list[FigureTrend]:
    """Return the trends of what whole repetitions show."""
    groups: dict[int, list[PointFigures]] = {}
    for one in points:
        if repetitions[one.repetition].complete:
            groups.setdefault(one.repetition, []).append(one)

    def trend(name: str, unit: str, values: Mapping[int, float]) -> list[FigureTrend]:
        return _trend(name, unit, {repetitions[key].hours: one for key, one in values.items()})

    def means(name: str) -> dict[int, float]:
        """Return the means over the set-points that have the figure; nan where one is not known."""
        values = {
            key: [one.figures[name] for one in group if name in one.figures]
            for key, group in groups.items()
        }
        return {key: float(np.mean(one)) for key, one in values.items() if one}

    found = trend("rms_error_percent", "%", means("rms_error_percent"))
    found += trend("noise_rms_percent", "%", means("noise_rms_percent"))
    found += trend("inverter_temperature_C", "degC", means("inverter_temperature_C"))
    for name, unit in units.items():
        read = {
            key: [value for one in group if np.isfinite(value := one.channels.get(name, np.nan))]
            for key, group in groups.items()
        }
        means_read = {key: float(np.mean(one)) for key, one in read.items() if one}
        found += trend(f"channel {name}" if name in OWN_FIGURES else name, unit, means_read)
    missed = {key: sum(one.missed for one in group) for key, group in groups.items()}
    return found + trend("missed_ticks", "ticks", missed)


def _of_points(
    repetitions: Mapping[int, Repetition], points: Iterable[PointFigures]
) -> list[FigureTrend]:
    """Return the trends of each set-point's torque, also of repetitions that are not whole."""
    series: dict[tuple[int, str], dict[float, float]] = {}
    labels = {}
    for one in points:
        labels[one.place] = one.label
        for name in ("rms_error_percent", "torque_mean_Nm"):
            at_h = repetitions[one.repetition].hours
            series.setdefault((one.place, name), {})[at_h] = one.figures.get(name, np.nan)
    units = {"rms_error_percent": "%", "torque_mean_Nm": "Nm"}
    return [
        replace(trend, of_point=True)
        for (place, name), values in sorted(series.items())
        for trend in _trend(f"{name} of {labels[place]}", units[name], values)
    ]


def _trend(name: str, unit: str, by_hours: Mapping[float, float]) -> list[FigureTrend]:
    """Return the trend of values by hours, of two or more that are known; else none."""
    known = sorted((hours, value) for hours, value in by_hours.items() if np.isfinite(value))
    if len(known) < 2:
        return []
    hours, values = np.array(known).T
    return [FigureTrend(name, unit, hours, values, slope(hours, values))]
