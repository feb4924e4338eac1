"""Trends of the figures of captured points over the repetitions of a soak."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from motord.experiments.soak.point_figures import PointFigures
from motord.experiments.soak.result import TITLES, FigureTrend, Repetition
from motord.experiments.soak.step import FALSE_ALARMS, most_likely_step
from motord.experiments.soak.trend import slope
from motord.intervals import beyond_chance


def repetitions_of(points: Sequence[PointFigures]) -> dict[int, Repetition]:
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


def of_repetitions(
    repetitions: Mapping[int, Repetition],
    points: Iterable[PointFigures],
    units: Mapping[str, str],
) -> list[FigureTrend]:
    """Return the trends of what whole repetitions show."""
    groups: dict[int, list[PointFigures]] = {}
    for one in points:
        if repetitions[one.repetition].complete:
            groups.setdefault(one.repetition, []).append(one)

    def trend(
        name: str, unit: str, values: Mapping[int, float], counts: bool = False
    ) -> list[FigureTrend]:
        by_hours = {repetitions[key].hours: one for key, one in values.items()}
        return _trend(name, unit, by_hours, counts)

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
        found += trend(f"channel {name}" if name in TITLES else name, unit, means_read)
    lines = {key: line for key, group in groups.items() if (line := _torque_line(group))}
    found += trend("torque_zero_Nm", "Nm", {key: zero_Nm for key, (zero_Nm, _) in lines.items()})
    found += trend("torque_gain_percent", "%", {key: 100 * k for key, (_, k) in lines.items()})
    missed = {key: sum(one.missed for one in group) for key, group in groups.items()}
    return found + trend("missed_ticks", "ticks", missed, counts=True)


def _torque_line(group: Sequence[PointFigures]) -> tuple[float, float] | None:
    """Return zero (Nm) and slope of the mean torque over the commanded one, by least squares.

    A zero that drifts moves all set-points alike, a gain each by its own torque. None where the
    mean of any that has one is not known (the line of the others is another one), or fewer than two
    torques were commanded.
    """
    points = [
        (one.torque_set_Nm, one.figures["torque_mean_Nm"])
        for one in group
        if "torque_mean_Nm" in one.figures
    ]
    if len({set_Nm for set_Nm, _ in points}) < 2 or not np.isfinite(points).all():
        return None
    set_Nm, mean_Nm = np.array(points).T
    gain, zero_Nm = np.polyfit(set_Nm, mean_Nm, 1)
    return float(zero_Nm), float(gain)


def of_points(
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


def with_steps(trends: Sequence[FigureTrend]) -> list[FigureTrend]:
    """Return the trends, those of which a step is no chance with it, all judged together."""
    steps = [most_likely_step(one.hours, one.values) for one in trends]
    known = beyond_chance([None if one is None else one.p_value for one in steps], FALSE_ALARMS)
    return [
        replace(
            one,
            step=replace(step, unit=one.unit),
            slope=slope(one.hours, one.values, step.place),
        )
        if step is not None and its
        else one
        for one, step, its in zip(trends, steps, known, strict=True)
    ]


def _trend(
    name: str, unit: str, by_hours: Mapping[float, float], counts: bool = False
) -> list[FigureTrend]:
    """Return the trend of values by hours, of two or more that are known; else none."""
    known = sorted((hours, value) for hours, value in by_hours.items() if np.isfinite(value))
    if len(known) < 2:
        return []
    hours, values = np.array(known).T
    return [FigureTrend(name, unit, hours, values, slope(hours, values, counts=counts))]
