"""By how much a calibration would have to move, by windows of turns that are forgotten with time.

Windows at about the same torque, in the same direction and of about the same age are a point of a
`LineFit`; each counts exp(-age / memory). The gains may drift: at age a the gain of a phase is
g (1 - u a GAIN_DRIFT_PER_S), with u = 0 +- 1 a parameter of its own.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from motord.calibration import Calibration, Harmonic
from motord.config import Config
from motord.experiments.calibration.estimate.lack_of_fit.effects import unit_torques
from motord.experiments.calibration.estimate.lack_of_fit.findings import MODEL_ACCURACY
from motord.experiments.calibration.estimate.least_squares.normal_equations import ALPHA, DELAY, ZOH
from motord.experiments.calibration.estimate.turn_spectrum import ANGLE_BINS
from motord.experiments.check_calibration.line_fit import LineFit
from motord.experiments.check_calibration.shift import ParameterShift, parameters_of
from motord.experiments.tracking.window_lines import WindowLines
from motord.identification import IdentifyError
from motord.identification.basis import Basis
from motord.identification.harmonics import over_one_turn

TORQUE_STEP = 0.1
"""Part of the rated torque within which set-points are one operating point."""

COMMON_GAIN_DRIFT = 5e-3
"""Part by which the common gain may have drifted unseen (standard deviation): magnets lose 0.1 % of
their flux per kelvin. Compensated currents make a constant torque less the cogging torque, in which
a common gain looks like cogging torque and offsets of another size."""

GAIN_DRIFT_PER_S = 0.01 / 3600
"""Part by which a gain may drift in a second (standard deviation): a hundredth in an hour."""

RECENT = 0.7
"""Age in parts of the memory up to which windows are recent ones: half of the weight is younger."""

LEAST_WINDOWS = 3
"""Windows that an operating point needs: by how they differ its noise is known."""

ALL_WINDOWS = 8
"""Windows over all operating points that an estimate needs."""

RESOLVED = 0.1
"""Share of windows that may be too fast for the orders that are looked at."""


Points = Sequence[Sequence[WindowLines]]
"""The windows of each operating point, in time order."""


def operating_points(windows: Sequence[WindowLines], config: Config, memory_s: float) -> Points:
    """Return the windows by torque, direction and age. Raises IdentifyError for too few."""
    if not windows:
        raise IdentifyError("no whole turns at a steady set-point with this calibration yet")
    highest = int(np.quantile([one.highest for one in windows], RESOLVED, method="lower"))
    step_Nm = TORQUE_STEP * config.motor.rated_torque_Nm
    recent_ns = windows[-1].t_ns - round(1e9 * RECENT * memory_s)
    found: dict[tuple[int, bool, bool], list[WindowLines]] = {}
    for one in windows:
        if one.highest >= highest:
            torque = round(one.torque_Nm / step_Nm)
            key = (torque, one.velocity_rad_s > 0, one.t_ns > recent_ns)
            found.setdefault(key, []).append(one)
    points = [one for one in found.values() if len(one) >= LEAST_WINDOWS]
    count = sum(map(len, points))
    if count < ALL_WINDOWS:
        raise IdentifyError(
            f"{count} windows of turns at torques that recur, at least {ALL_WINDOWS} are needed: "
            "hold steady torques, again and again, with compensation on"
        )
    return points


def tracked_shift(
    points: Points, calibration: Calibration, config: Config, memory_s: float
) -> ParameterShift:
    """Return by how much the calibration would have to move, as of the newest window."""
    motor = config.motor
    highest = min(one.highest for point in points for one in point)
    newest_ns = max(point[-1].t_ns for point in points)
    theta, harmonics = parameters_of(calibration, highest)
    gain = theta[ALPHA]
    bins = motor.model_copy(update={"counts": min(motor.counts, ANGLE_BINS)})
    basis = Basis.of(bins, tuple(one.order for one in harmonics))
    ages_s = [np.maximum([1e-9 * (newest_ns - w.t_ns) for w in point], 0.0) for point in points]
    weights = [np.exp(-age_s / memory_s) for age_s in ages_s]
    columns = np.array(
        [_columns(*one, basis, gain, highest) for one in zip(points, weights, strict=True)]
    )
    age_s = np.array([age @ w / w.sum() for age, w in zip(ages_s, weights, strict=True)])
    drift = -columns[:, ALPHA] * (gain * GAIN_DRIFT_PER_S)[:, None] * age_s[:, None, None]
    size = theta.size
    prior = np.eye(size + 3)[[DELAY, ZOH, *range(size - 1, size + 3)]]
    prior[2, :size] = _common_gain(gain, size)
    fit = LineFit(
        groups_Nm=[np.array([one.residual_Nm[:highest] for one in point]) for point in points],
        columns=np.concatenate([columns, drift], axis=1),
        prior=prior,
        model_Nm=np.hypot(
            MODEL_ACCURACY * motor.rated_torque_Nm / 3**0.5,
            _hold_error_Nm(points, harmonics, highest),
        ),
        lowest_order=min(motor.pole_pairs, highest),
        weights=weights,
    )
    errors = fit.errors
    return ParameterShift(
        theta=theta,
        change=fit.change[:size],
        errors=replace(errors, parts=errors.parts[:, :size, :size]),
        seen=fit.seen[:size, :size],
        misfit=fit.misfit,
        orders=basis.orders,
        turns=tuple(sum(one.turns for one in point) for point in points),
    )


def _hold_error_Nm(points: Points, harmonics: Sequence[Harmonic], highest: int) -> np.ndarray:
    """Return the error (highest,) of the model of the zero-order hold, at each order.

    For an order h of the cogging torque of amplitude A, the age of the currents and the correction
    of the hold are good to second order in w = h velocity period; the remainder is A w^3 / 6.
    """
    windows = [one for point in points for one in point]
    turned_rad = max(abs(one.velocity_rad_s) * one.period_s for one in windows)
    hold_error_Nm = np.zeros(highest)
    for one in harmonics:
        hold_error_Nm[one.order - 1] = abs(one.amplitude_Nm) * (one.order * turned_rad) ** 3 / 6
    return hold_error_Nm


def _common_gain(gain: np.ndarray, size: int) -> np.ndarray:
    """Return the direction (size,) of the common gain, in COMMON_GAIN_DRIFT."""
    direction = np.zeros(size)
    direction[ALPHA] = 1 / (3 * gain * COMMON_GAIN_DRIFT)
    return direction


def _columns(
    windows: Sequence[WindowLines],
    weights: np.ndarray,
    basis: Basis,
    gain: np.ndarray,
    highest: int,
) -> np.ndarray:
    """Return the lines (p, highest) of a unit of each parameter, mean of the windows."""
    bins = basis.back_emf.shape[0]
    lines = [one.command_A[: highest + 1] for one in windows]
    command_A = np.average(lines, axis=0, weights=weights)
    velocity_rad_s = np.average([one.velocity_rad_s for one in windows], weights=weights)
    own = unit_torques(
        np.column_stack([over_one_turn(column, bins) for column in command_A.T]),
        np.full(bins, velocity_rad_s),
        basis.back_emf,
        basis.cogging,
        gain,
        windows[-1].period_s,
    )
    return np.asarray(2 / bins * np.fft.rfft(own.T, axis=1)[:, 1 : highest + 1])
