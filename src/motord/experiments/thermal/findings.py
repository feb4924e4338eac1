"""What is questionable about thermal constants, each with its meaning and what to do.

Drift of the ambient and lag of a sensor are score tests: a column is added to the linear form of
the fit, and what it takes is compared with its standard error.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from motord.experiments.signal_findings import current_scale
from motord.experiments.thermal.course import Readings
from motord.experiments.thermal.estimate import ThermalFit, whiten
from motord.experiments.thermal.recordings import STOPPED
from motord.experiments.thermal.result import ThermalConstants
from motord.findings import Finding

COVERAGE_FACTOR = 4.0
"""Standard errors that an effect must exceed to be a finding."""

MISFIT_PERCENT = 1.0
"""Part of a channel's rise that residuals may differ from zero by for a while."""

MISFIT_BLOCKS = 24
"""Blocks of time over which residuals are averaged for that."""

DRIFT_PERCENT = 0.5
"""Part of the rise that the ambient may have drifted."""

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
    found: ThermalConstants, frozen: dict[str, float], readings: Iterable[Readings]
) -> tuple[Finding, ...]:
    """Return what is questionable.

    frozen: channels and the seconds for which they were; readings: of each channel, as recorded.
    """
    constants_s = (one.time_constant_s.value for one in found.time_constants)
    fit, shortest_s = found.fit, min(filter(None, constants_s))
    return (
        *current_scale(fit.course.current_ratios, "all K/W and J/K go with their square"),
        *_frozen(frozen),
        *_constant(readings),
        *_invalid(readings),
        *_runaway(found),
        *_not_steady(found),
        *_misfit(fit),
        *_ambient_drift(fit),
        *_lags(fit, shortest_s),
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


def _score(fit: ThermalFit, columns: list[np.ndarray]) -> tuple[float, float]:
    """Return how much of further columns (n_i,) the residuals have, and its standard error."""
    column, residual, jacobian = (
        whiten(fit.noises, columns),
        fit.whitened_residual,
        fit.whitened_jacobian,
    )
    column = column - jacobian @ np.linalg.lstsq(jacobian, column, rcond=None)[0]
    square = float(column @ column)
    if not square > 0:
        return 0.0, np.inf
    scale = np.sqrt(float(residual @ residual) / fit.freedom)
    return float(column @ residual) / square, float(scale / np.sqrt(square))


def _ambient_drift(fit: ThermalFit) -> Iterator[Finding]:
    course = fit.course
    if course.ambient is not None:
        return
    still, steps = np.zeros(len(course.nodes)), course.squares_A2.size
    ramp = np.linspace(-0.5, 0.5, steps)
    moved = fit.network.temperatures_C(still, np.zeros(steps), ramp, course.step_s)
    ends_s = course.step_s * np.arange(steps + 1)
    columns = [
        np.interp(each.t_s, ends_s, moved[:, n]) for n, each in enumerate(course.readings.values())
    ]
    drift_K, stderr_K = _score(fit, columns)
    limit_K = max(
        COVERAGE_FACTOR * stderr_K,
        DRIFT_PERCENT / 100 * max(float(np.ptp(one)) for one in fit.fitted_C),
    )
    if abs(drift_K) > limit_K:
        yield Finding(
            "ambient-drifts", abs(drift_K), limit_K, "K", "warning",
            f"the ambient {'rose' if drift_K > 0 else 'fell'} by about this much meanwhile, and "
            "the fit takes it as constant",
            "measure it and name it as ambient_channel, or keep the room's temperature",
        )  # fmt: skip


def _lags(fit: ThermalFit, shortest_s: float) -> Iterator[Finding]:
    for n, each in enumerate(fit.course.readings.values()):
        columns = [np.zeros(one.t_s.size) for one in fit.course.readings.values()]
        columns[n] = -np.gradient(fit.fitted_C[n], each.t_s)
        lag_s, stderr_s = _score(fit, columns)
        limit_s = max(COVERAGE_FACTOR * stderr_s, LAG_PART * shortest_s)
        if lag_s > limit_s:
            yield Finding(
                "sensor-lag", lag_s, limit_s, "s", "warning",
                f"{each.channel} follows its node late, about by this time: short time constants "
                "and heat capacities are too large",
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
