"""Ripple of the points of a repetition, freed of noise, as `verify` has it of its mesh."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf, nan, sqrt
from typing import Any

import numpy as np

from motord.experiments.hold_timing import phase_hold
from motord.experiments.ripple_findings import findings, is_hidden
from motord.experiments.shaft_ripple import shaft_ripple
from motord.experiments.subject import Subject
from motord.findings import Finding, listed
from motord.identification import CaptureError, IdentifyError
from motord.identification.disturbances.lines_of_points import DetectedLines, with_asynchronous
from motord.identification.operating_points import Samples, prepare, split
from motord.identification.point_ripple import PointRipple
from motord.intervals import coverage_factor
from motord.recording.captures import COLUMNS
from motord.recording.reader import Run, bounds_of


def set_point_label(point: Mapping[str, Any]) -> str:
    """Return a point of the inner plan as text."""
    place = int(point["inner_index"]) + 1
    return f"point {place}, {point['torque_Nm']:g} Nm, {point['speed_Hz']:g} Hz"


def capture_label(run: Run, point: Mapping[str, Any]) -> str:
    """Return recording, repetition and point as text."""
    return f"{run.path.name}: repetition {int(point['repetition'])}, {set_point_label(point)}"


def point_ripples(
    run: Run, points: Sequence[Mapping[str, Any]], subject: Subject
) -> dict[int, PointRipple | CaptureError]:
    """Return the ripple of good points by index, or why they have none.

    Points that do not hold their set-points have none, and no reason: only plans of points that
    hold them for a number of turns have `turns` among their settings. Raises IdentifyError, with
    recording, repetition and point.
    """
    motor, sensor = subject.motor, subject.sensor
    inner = run.plan_metadata.get("settings", {}).get("inner")
    turns = isinstance(inner, Mapping) and "turns" in inner
    points = [one for one in points if turns and one["speed_Hz"]]
    hold = phase_hold(run)
    index, found = [], []
    unusable: dict[int, PointRipple | CaptureError] = {}
    for number, samples in _samples(run, points, subject):
        if isinstance(samples, CaptureError):
            unusable[number] = samples
            continue
        index.append(number)
        lines = DetectedLines.of(samples, motor.counts)
        found.append((shaft_ripple(samples, motor, sensor, hold), lines))
    again = (one for _, one in _samples(run, points, subject) if isinstance(one, Samples))
    ripples = with_asynchronous(found, again, motor, sensor)
    return unusable | dict(zip(index, ripples, strict=True))


def _samples(
    run: Run, points: Sequence[Mapping[str, Any]], subject: Subject
) -> Iterator[tuple[int, Samples | CaptureError]]:
    """Yield the samples of points by index, or why they cannot be used. Raises IdentifyError."""
    for point in points:
        for data in split(run.ticks(COLUMNS, **bounds_of(point)), [point]):
            try:
                yield int(point["index"]), prepare(data, subject.motor.counts)
            except CaptureError as error:
                yield int(point["index"]), error
            except IdentifyError as error:
                raise IdentifyError(f"{capture_label(run, point)}: {error}") from error


def noise_rms_Nm(ripple: PointRipple) -> float:
    """Return the RMS of a turn's noise, in its orders, by even and odd turns; nan of one turn."""
    if ripple.turns < 2:
        return nan
    odd = ripple.turns // 2
    apart_Nm = ripple.even_odd_Nm[0] - ripple.even_odd_Nm[1]
    per_turn = odd * (ripple.turns - odd) / ripple.turns  # the inverse of 1 / odd + 1 / even
    return sqrt(per_turn / 2 * float((np.abs(apart_Nm) ** 2).sum()))


def without_orders(ripple: PointRipple) -> PointRipple:
    """Return the ripple without its orders: those of thousands of points take much memory."""
    none = np.empty(0)
    return replace(ripple, order=none, line_Nm=none, noise_Nm=none, even_odd_Nm=none)


def ripple_findings(ripples: Sequence[tuple[str, int, PointRipple]]) -> tuple[Finding, ...]:
    """Return what is questionable about the ripple.

    Of each point of the inner plan, where it is known worst: of the repetitions where noise hides
    it, and of the others; with the faults of all of them. ripples: as of `changed_behind_noise`.
    """
    worst: dict[tuple[str, int, bool], PointRipple] = {}
    for label, _, one in ripples:
        key = label, one.compensate, is_hidden(one)
        before = worst.get(key, replace(one, faults=()))
        most = max(before, one, key=_uncertainty)
        worst[key] = replace(most, faults=(*before.faults, *one.faults))
    consequence = "slopes are as uncertain where that differs from repetition to repetition"
    hidden = "no slope of it is stated, as that is so in one repetition or more"
    return findings(list(worst.values()), consequence, hidden) if worst else ()


def changed_behind_noise(ripples: Sequence[tuple[str, int, PointRipple]]) -> Iterator[Finding]:
    """Yield a finding where the ripple of a set-point that has no slope changed beyond chance.

    ripples: with the labels of their points in the inner plan, and repetitions. It changed where
    the interval of an RMS error is above those of all repetitions in which noise hides it; chance
    makes that so in 5 % of soaks at most, as intervals are of all ripples together
    (Bonferroni).
    """
    known: dict[str, list[tuple[int, PointRipple]]] = {}
    for label, number, one in ripples:
        if one.stderr_percent is not None:
            known.setdefault(label, []).append((number, one))
    factor = coverage_factor(figures=max(sum(map(len, known.values())), 1))
    changed = []
    for label, series in known.items():
        hidden = [_interval(one, factor)[1] for _, one in series if is_hidden(one)]
        low, number = max((_interval(one, factor)[0], number) for number, one in series)
        if hidden and low > max(hidden):
            at = f"{label}, most in repetition {number}"
            changed.append((low - max(hidden), low, max(hidden), at))
    if changed:
        _, low, most, _ = max(changed)
        yield Finding(
            "ripple-changed", low, most, "% of rated", "warning",
            f"{listed([at for *_, at in changed])}: the RMS error is larger than it can have been "
            "in the repetitions in which noise hides it; no slope of it is stated, but it changed",
            "look for what wears, slips or gets loose; to know the slope, end what disturbs the "
            "torque sensor in the other repetitions (mains, a loose shield), or take more turns",
        )  # fmt: skip


def _interval(one: PointRipple, factor: float) -> tuple[float, float]:
    """Return the ends of the interval of the RMS error (%), `factor` standard errors of its square.

    It is the square that is normal, of which the standard error is that above it.
    """
    square = one.rms_percent**2
    half = factor * ((one.rms_percent + (one.stderr_percent or 0.0)) ** 2 - square)
    return sqrt(max(square - half, 0.0)), sqrt(square + half)


def _uncertainty(one: PointRipple) -> float:
    return inf if one.stderr_percent is None else one.stderr_percent
