"""What is questionable about thermal constants, each with its meaning and what to do."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from motord.experiments.signal_findings import current_scale
from motord.experiments.thermal.course import Readings
from motord.experiments.thermal.departures import Departure
from motord.experiments.thermal.estimate import ThermalFit
from motord.experiments.thermal.recordings import STOPPED
from motord.experiments.thermal.result import QUIET_K, ThermalConstants
from motord.findings import Finding

COVERAGE_FACTOR = 4.0
"""Standard errors that an effect must exceed to be a finding."""

MISFIT_PERCENT = 1.0
"""Part of a channel's rise that residuals may differ from zero by for a while."""

MISFIT_BLOCKS = 24
"""Blocks of time over which residuals are averaged for that."""

DRIFT_PERCENT = 0.5
"""Part of the rise that the ambient may have drifted."""

COOLING_PERCENT = 1.0
"""Part of the conductance to the ambient by which it may differ between heat-up and cooling."""

LAG_PART = 0.03
"""Part of the shortest time constant that a sensor may lag."""

INVALID_PERCENT = 5.0
"""Part of the readings that may be invalid."""

FROZEN_READINGS = 20
"""Readings of the very same number from which on a channel may be frozen."""

FROZEN_K = 0.1
"""What the temperature must have moved meanwhile, at least; and by 5 times noise and resolution."""

SAME_K = 1e-9
"""Difference of two means of the very same number, by rounding."""

SLOW_PART = 0.25
"""Part of the shortest time constant that readings may be apart."""


def findings(
    found: ThermalConstants,
    shown: Sequence[Departure],
    frozen: dict[str, float],
    readings: Iterable[Readings],
) -> tuple[Finding, ...]:
    """Return what is questionable.

    shown: departures from the network, whatever their size; frozen: channels and the seconds for
    which they were; readings: of each channel, as recorded.
    """
    constants_s = (one.time_constant_s.value for one in found.time_constants)
    fit, shortest_s = found.fit, min(filter(None, constants_s))
    return (
        *current_scale(fit.course.current_ratios, "all K/W and J/K go with their square"),
        *_frozen(frozen),
        *_constant(readings),
        *_invalid(readings),
        *_noise_free(found),
        *_runaway(found),
        *_not_steady(found),
        *_misfit(fit),
        *_around(fit, shown),
        *_lags(shown, shortest_s),
        *_slow(fit, shortest_s),
    )


def frozen_spans(readings: Readings, fitted_C: np.ndarray) -> list[slice]:
    """Return where a channel gave the very same number while the temperature moved."""
    valid = np.flatnonzero(np.isfinite(readings.value_C))
    steps = np.abs(np.diff(readings.value_C[valid]))
    steps = np.where(steps > SAME_K, steps, 0.0)
    edges = np.concatenate([[0], 1 + np.flatnonzero(steps), [valid.size]])
    moved = steps[steps > 0]
    limit_K = max(FROZEN_K, 5 * float(np.median(moved)) if moved.size else 0.0)
    spans = [slice(int(valid[a]), int(valid[b - 1]) + 1) for a, b in pairwise(edges)]
    return [
        span
        for span, number in zip(spans, np.diff(edges), strict=True)
        if number >= FROZEN_READINGS and np.ptp(fitted_C[span]) > limit_K
    ]


def _frozen(frozen: dict[str, float]) -> Iterator[Finding]:
    for channel, seconds in frozen.items():
        yield Finding(
            "channel-frozen", seconds, 0.0, "s", "warning",
            f"{channel} gave the very same number while the temperature moved; these readings were "
            "left out",
            "see the sensor and its device; frozen_after_s of [[channels]] shows it at once",
        )  # fmt: skip


def _constant(readings: Iterable[Readings]) -> Iterator[Finding]:
    """Yield a finding for each channel that gave one number all the time."""
    for each in readings:
        if np.nanmax(each.value_C) == np.nanmin(each.value_C):
            yield Finding(
                "channel-frozen", float(np.ptp(each.t_s)), 0.0, "s", "serious",
                f"{each.channel} gave the very same number all the time: its node counts as one "
                "that never gets warm, and all constants are wrong",
                "see the sensor and its device, or leave this channel out of [plans.thermal]",
            )  # fmt: skip


def _invalid(readings: Iterable[Readings]) -> Iterator[Finding]:
    for each in readings:
        percent = 100 * float(np.mean(~np.isfinite(each.value_C)))
        if percent > INVALID_PERCENT:
            yield Finding(
                "readings-invalid", percent, INVALID_PERCENT, "%", "warning",
                f"{each.channel} had no valid reading for this part of the time",
                "see the sensor, its wiring and valid_min and valid_max of [[channels]]",
            )  # fmt: skip


def _noise_free(found: ThermalConstants) -> Iterator[Finding]:
    if found.noise_free:
        yield Finding(
            "noise-free", max(found.residual_K), QUIET_K, "K", "warning",
            "readings depart from the network by less than those of any thermometer: they are "
            "simulated or smoothed. The error of time constants and steady temperatures is not "
            "known from them, and intervals of K/W and J/K have that of the heat alone",
            "record the channels as they are read, without a filter; of a simulation compare with "
            "its truth",
        )  # fmt: skip


def _runaway(found: ThermalConstants) -> Iterator[Finding]:
    feedback, steady = found.fit.feedback_W_per_K, found.fit.network.steady_rise_K(1.0)[0]
    if not any(one.phase == "heat-up" for one in found.time_constants):
        yield Finding(
            "thermal-runaway", feedback * steady, 1.0, "parts", "serious",
            "with this current the loss rises faster with the temperature than heat flows off: "
            "there is no steady temperature",
            "lower torque_Nm or current_A",
        )  # fmt: skip


def _not_steady(found: ThermalConstants) -> Iterator[Finding]:
    for one in found.steady:
        steady_C = one.steady_C.value
        if steady_C is None or not one.extrapolated:
            continue
        missing = 100 * abs(steady_C - one.end_C) / abs(steady_C - found.ambient_C)
        yield Finding(
            "not-steady", missing, 2.0, "%", "note" if missing < 20 else "warning",
            f"{one.channel} had this part of its rise still to come when the heat-up ended "
            f"({found.ended_by[0]}): its steady temperature is extrapolated by the model",
            "raise heating_max_s, or lower the current if temperature_max_C ended it",
        )  # fmt: skip
    slowest_s = found.time_constants[0].time_constant_s.value
    if found.ended_by[1] == STOPPED and slowest_s is not None:
        yield Finding(
            "cooling-cut-short", found.cooling_s, slowest_s, "s",
            "note", "the plan did not end the cooling: what was recorded of it is used",
            "let the plan end by itself",
        )  # fmt: skip


def _misfit(fit: ThermalFit) -> Iterator[Finding]:
    """Yield a finding for each channel whose residuals stay away from zero."""
    every = zip(fit.course.readings.values(), fit.fitted_C, fit.residuals_K, strict=True)
    for each, fitted_C, left in every:
        block = (each.t_s / fit.course.duration_s * MISFIT_BLOCKS).astype(int)
        block = np.minimum(block, MISFIT_BLOCKS - 1)
        known = np.isfinite(left)
        number = np.maximum(np.bincount(block[known], minlength=MISFIT_BLOCKS), 1)
        means = np.bincount(block[known], left[known], MISFIT_BLOCKS) / number
        noise_K = float(np.nanstd(np.diff(left))) / np.sqrt(2 * number.min())
        rise_K = float(np.ptp(fitted_C))
        percent, by_chance = (
            100 * float(np.abs(means).max()) / rise_K,
            100 * COVERAGE_FACTOR * noise_K / rise_K,
        )
        limit = max(MISFIT_PERCENT, by_chance)
        if percent > limit:
            yield Finding(
                "lack-of-fit", percent, limit, "%", "serious",
                f"{each.channel} departs from the network by this part of its rise: there are more "
                "heat paths than measured nodes, heat other than copper loss, or cooling differs "
                "between turning and standstill",
                "see the residuals in the report; measure more nodes (winding, magnet, housing)",
            )  # fmt: skip


def _around(fit: ThermalFit, shown: Sequence[Departure]) -> Iterator[Finding]:
    """Yield what explains the residuals best: another ambient, or another cooling.

    A sensor that lags looks like the latter where the current ends; also of a lag that is too small
    for a finding it is none.
    """
    rise_K = max(float(np.ptp(one)) for one in fit.fitted_C)
    least = {"ambient": DRIFT_PERCENT / 100 * rise_K, "cooling": COOLING_PERCENT / 100}
    limits = [
        (one, max(COVERAGE_FACTOR * one.stderr, least[one.kind]))
        for one in shown
        if one.kind in least
    ]
    late = max((one.ratio for one in shown if one.kind == "lag" and one.value > 0), default=0.0)
    beyond = [
        (one, limit)
        for one, limit in limits
        if abs(one.value) > limit and (one.kind != "cooling" or one.ratio > late)
    ]
    if not beyond:
        return
    best, limit = max(beyond, key=lambda pair: pair[0].ratio)
    if best.kind == "cooling":
        yield Finding(
            "cooling-changes", 100 * abs(best.value), 100 * limit, "%", "warning",
            f"without current about this part {'more' if best.value > 0 else 'less'} heat "
            "flowed off to the ambient than with it, and the network is one for both",
            "let the rotor turn as fast, and fans run, in both or in neither",
        )  # fmt: skip
        return
    how = "wandered" if best.degree > 1 else "rose" if best.value > 0 else "fell"
    yield Finding(
        "ambient-drifts", abs(best.value), limit, "K", "warning",
        f"the ambient {how} by about this much meanwhile, and the fit takes it as constant",
        "measure it and name it as ambient_channel, or keep the room's temperature",
    )  # fmt: skip


def _lags(shown: Sequence[Departure], shortest_s: float) -> Iterator[Finding]:
    for one in shown:
        if one.kind != "lag":
            continue
        limit_s = max(COVERAGE_FACTOR * one.stderr, LAG_PART * shortest_s)
        if one.value > limit_s:
            yield Finding(
                "sensor-lag", one.value, limit_s, "s", "serious",
                f"{one.channel} follows its node late, by about this time constant: it is taken "
                "out as a lag of the first order, and intervals do not hold what is another",
                "mount the sensor with less thermal resistance, nearer to the copper",
            )  # fmt: skip


def _slow(fit: ThermalFit, shortest_s: float) -> Iterator[Finding]:
    for each in fit.course.readings.values():
        period_s = float(np.median(np.diff(each.t_s)))
        if period_s > SLOW_PART * shortest_s:
            yield Finding(
                "slow-readings", period_s, SLOW_PART * shortest_s, "s", "note",
                f"{each.channel} is read seldom compared to the shortest time constant, "
                f"{shortest_s:.3g} s, which rests on few readings",
                "raise its rate_Hz in [[channels]]",
            )  # fmt: skip
