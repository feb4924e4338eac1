"""By how much a calibration would have to move, by windows of turns that are forgotten with time.

Windows at about the same torque and in the same direction are a point of a `LineFit`; each counts
exp(-age / memory).
"""

from collections.abc import Sequence

import numpy as np

from motord.calibration import Calibration
from motord.config import Config
from motord.experiments.calibration.estimate.lack_of_fit.effects import unit_torques
from motord.experiments.calibration.estimate.lack_of_fit.findings import MODEL_ACCURACY
from motord.experiments.calibration.estimate.normal_equations import ALPHA, DELAY, ZOH
from motord.experiments.calibration.estimate.turn_spectrum import ANGLE_BINS
from motord.experiments.check_calibration.line_fit import LineFit
from motord.experiments.check_calibration.shift import ParameterShift
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

LEAST_WINDOWS = 3
"""Windows that an operating point needs: by how they differ its noise is known."""

ALL_WINDOWS = 8
"""Windows over all operating points that an estimate needs."""

RESOLVED = 0.1
"""Share of windows that may be too fast for the orders that are looked at."""


def tracked_shift(
    windows: Sequence[WindowLines], calibration: Calibration, config: Config, memory_s: float
) -> ParameterShift:
    """Return by how much the calibration would have to move, as of the newest window.

    Raises IdentifyError where the windows are too few.
    """
    if not windows:
        raise IdentifyError("no whole turns at a steady set-point with this calibration yet")
    motor = config.motor
    highest = int(np.quantile([one.highest for one in windows], RESOLVED, method="lower"))
    points = [
        point
        for point in _points([one for one in windows if one.highest >= highest], config)
        if len(point) >= LEAST_WINDOWS
    ]
    if sum(map(len, points)) < ALL_WINDOWS:
        raise IdentifyError(
            f"{sum(map(len, points))} windows of turns at torques that recur, at least "
            f"{ALL_WINDOWS} are needed"
        )
    harmonics = [one for one in calibration.tau_cog_harmonics if one.order <= highest]
    waves = [h.amplitude_Nm * part(h.phase_rad) for h in harmonics for part in (np.sin, np.cos)]
    gain = calibration.delta_epsilon * np.array(calibration.alpha)
    theta = np.concatenate([gain, calibration.beta_A, [0.0, 0.0], waves])
    bins = motor.model_copy(update={"counts": min(motor.counts, ANGLE_BINS)})
    basis = Basis.of(bins, tuple(one.order for one in harmonics))
    newest_ns = windows[-1].t_ns
    weights = [
        np.exp(np.minimum([1e-9 * (one.t_ns - newest_ns) for one in point], 0.0) / memory_s)
        for point in points
    ]
    each = list(zip(points, weights, strict=True))
    fit = LineFit(
        groups_Nm=[np.array([one.left_Nm[:highest] for one in point]) for point in points],
        columns=np.array([_columns(*one, basis, gain, highest) for one in each]),
        prior=np.array([*np.eye(theta.size)[[DELAY, ZOH]], _common_gain(gain, theta.size)]),
        model_Nm=MODEL_ACCURACY * motor.rated_torque_Nm / 3**0.5,
        lowest_order=min(motor.pole_pairs, highest),
        weights=weights,
    )
    return ParameterShift(
        theta=theta,
        change=fit.change,
        errors=fit.errors,
        seen=fit.seen,
        misfit=fit.misfit,
        orders=basis.orders,
        turns=tuple(sum(one.turns for one in point) for point in points),
    )


def _common_gain(gain: np.ndarray, size: int) -> np.ndarray:
    """Return the direction (size,) of the common gain, in COMMON_GAIN_DRIFT."""
    direction = np.zeros(size)
    direction[ALPHA] = 1 / (3 * gain * COMMON_GAIN_DRIFT)
    return direction


def _points(windows: Sequence[WindowLines], config: Config) -> list[list[WindowLines]]:
    """Return the windows of each operating point, in time order."""
    step_Nm = TORQUE_STEP * config.motor.rated_torque_Nm
    found: dict[tuple[int, bool], list[WindowLines]] = {}
    for one in windows:
        key = (round(one.torque_Nm / step_Nm), one.velocity_rad_s > 0)
        found.setdefault(key, []).append(one)
    return list(found.values())


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
