"""Cogging torque from a rotor that is driven from outside without current (Poels 2008, chapter 3).

At each speed the torque is fitted by the orders that slots and poles allow, and by such others as
stand out of the noise. The columns are waves of the measured angle, passed through the sensor in
time, sample by sample: the mount's resonance at each instant's frequency, then the high-pass. So
the ripple of the speed, which the cogging torque itself drives against a flexible belt, matters
nothing. Mean and slope over each turn are taken out: drift.

The angle is that of a smooth motion through the encoder's counts, finer than these. Where the rotor
sticks and slips there is none: then the waves are of the counted angle itself, each count's cell
seen by its mean (`cell_gain`), and torque and waves are averaged over each visit of a cell, so that
a rest of a second weighs no more than a cell that is passed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification import IdentifyError
from motord.identification.basis import cell_gain, highpass
from motord.identification.cluster_robust_ls import FEWEST_TURNS, ClusterFit, Regressors, first_rows
from motord.identification.harmonics import lines_at
from motord.identification.orders import (
    SAMPLES_PER_COGGING_ORDER,
    allowed_orders,
    order_limit,
    resolved_order,
)
from motord.identification.rotor.driven_rotor import Driven
from motord.identification.torque.torque_sensor import (
    order_below_resonance,
    passed_by_mount,
    response,
)

REQUIRED = ("torque_Nm",)
"""Columns that are needed, besides time and angle."""

COUNTS_PER_ORDER = 3
"""Encoder counts that a period of the highest order needs."""

STANDS_OUT = 6.0
"""Amplitude, in standard errors, from which an order that is not allowed is stated."""

MOST_OTHERS = 24
"""Orders that are not allowed and are fitted all the same, at most."""


@dataclass(frozen=True)
class SpeedCogging:
    """Cogging torque at one speed. Lines: order h is Re(line exp(j h theta)), Nm.

    order (n,), line_Nm (n,), stderr_Nm (n,): the fitted orders, per component; spectrum_Nm (m,):
    lines of all orders 1 to m; noise_Nm (m,): level of noise per component in the spectrum.
    speed_ripple: (largest - smallest) / (2 mean) speed. direction: 1 or -1; jerky: the counted
    angle was used; motion_residual_counts: RMS residual of the smooth motion.
    """

    speed_set_Hz: float
    speed_Hz: float
    direction: int
    jerky: bool
    motion_residual_counts: float
    turns: int
    speed_ripple: float
    order: np.ndarray
    line_Nm: np.ndarray
    stderr_Nm: np.ndarray
    spectrum_Nm: np.ndarray
    noise_Nm: np.ndarray


def highest_order(driven: Driven, motor: MotorConfig, sensor: TorqueSensorConfig) -> int:
    """Return the highest order that sampling, encoder and mount let through."""
    highest = resolved_order(
        driven.samples_per_turn,
        motor.counts,
        order_limit(motor.slots, 2 * motor.pole_pairs),
        samples_per_order=SAMPLES_PER_COGGING_ORDER,
        counts_per_order=COUNTS_PER_ORDER,
    )
    return order_below_resonance(sensor, highest, driven.speed_Hz)


def at_speed(
    driven: Driven, motor: MotorConfig, sensor: TorqueSensorConfig, others: Sequence[int] = ()
) -> SpeedCogging:
    """Return the cogging torque at the allowed orders and at `others`. Raises IdentifyError."""
    highest = highest_order(driven, motor, sensor)
    order = _fitted_orders(driven, motor, highest, others)
    end = driven.turns[-1][1]
    angle_rad, speed_rad_s = _angle_and_speed(driven, end)
    columns = _columns(order, driven, angle_rad, speed_rad_s, sensor)
    torque_Nm = driven.ticks["torque_Nm"][:end].astype(float)
    rows, turn = _by_turn(driven.turns)
    steady = _without_trend(np.column_stack([columns, torque_Nm])[rows], driven.t_s[rows], turn)
    if driven.jerky:
        visit = _visits(angle_rad[rows], turn, motor.counts)
        steady = np.add.reduceat(steady, visit) / np.diff(visit, append=turn.size)[:, None]
        rows, turn = rows[visit], turn[visit]
    regressors = Regressors.of(steady[:, :-1], first_rows(turn), FEWEST_TURNS)
    fit = regressors.fit(steady[:, -1])
    variance, line_Nm = np.diag(fit.covariance), fit.solution[0::2] - 1j * fit.solution[1::2]
    spectrum_Nm = _spectrum(angle_rad[rows], fit, driven, motor, sensor, highest)
    noise_Nm = _noise(spectrum_Nm, order)
    spectrum_Nm[order - 1] += line_Nm
    speeds = np.abs(speed_rad_s[rows])
    return SpeedCogging(
        speed_set_Hz=driven.speed_set_Hz,
        speed_Hz=driven.speed_Hz,
        direction=driven.direction,
        jerky=driven.jerky,
        motion_residual_counts=driven.residual_rms_rad * motor.counts / (2 * np.pi),
        turns=len(driven.turns),
        speed_ripple=float(np.ptp(speeds) / (2 * speeds.mean())),
        order=order,
        line_Nm=line_Nm,
        stderr_Nm=np.sqrt((variance[0::2] + variance[1::2]) / 2),
        spectrum_Nm=spectrum_Nm,
        noise_Nm=noise_Nm,
    )


def standing_out(found: Sequence[SpeedCogging]) -> tuple[int, ...]:
    """Return the orders that were not fitted and stand out of the noise over all speeds."""
    highest = min(one.spectrum_Nm.size for one in found)
    fitted = set(found[0].order.tolist())
    weight = np.array([1 / one.noise_Nm[:highest] ** 2 for one in found])
    lines = np.array([one.spectrum_Nm[:highest] for one in found])
    mean = (weight * lines).sum(axis=0) / weight.sum(axis=0)
    ratio = np.abs(mean) * np.sqrt(weight.sum(axis=0))
    order = np.argsort(-ratio) + 1
    out = [int(o) for o in order if ratio[o - 1] > STANDS_OUT and int(o) not in fitted]
    return tuple(sorted(out[:MOST_OTHERS]))


def _fitted_orders(
    driven: Driven, motor: MotorConfig, highest: int, others: Sequence[int]
) -> np.ndarray:
    """Return the orders up to `highest` to fit. Raises IdentifyError without an allowed one."""
    poles = 2 * motor.pole_pairs
    allowed = allowed_orders(motor.slots, poles, highest)
    if not allowed:
        raise IdentifyError(
            f"{driven.label}: {driven.samples_per_turn} samples a turn and {motor.counts} counts "
            f"show orders up to {highest}; {motor.slots} slots and {poles} poles have none below "
            f"{min(motor.slots, poles)}: turn slower or sample faster"
        )
    return np.array(sorted({*allowed, *(o for o in others if o <= highest)}))


def _angle_and_speed(driven: Driven, end: int) -> tuple[np.ndarray, np.ndarray]:
    """Return angle and speed (end,): of the smooth motion, or as counted and roughly."""
    t_s = driven.t_s[:end]
    if driven.jerky:
        return driven.motion.position_rad[:end], driven.motion.spline.derivative()(t_s)
    return driven.motion.at(t_s)


def _columns(
    order: np.ndarray,
    driven: Driven,
    angle_rad: np.ndarray,
    speed_rad_s: np.ndarray,
    sensor: TorqueSensorConfig,
) -> np.ndarray:
    """Return cos and sin of each order (n, 2 m) as the sensor gives them."""
    if driven.jerky:
        columns = _counted_columns(order, driven, angle_rad, sensor)
    else:
        columns = _smooth_columns(order, angle_rad, speed_rad_s, sensor)
    tau_s = sensor.highpass_time_constant_s
    if tau_s > 0:
        state = np.stack([columns[driven.turns[0][0] :].mean(axis=0), columns[0]])
        t_s = driven.t_s[: angle_rad.size]
        highpass(columns, np.diff(t_s, prepend=t_s[:1]), tau_s, state)
    return columns


def _smooth_columns(
    order: np.ndarray, angle_rad: np.ndarray, speed_rad_s: np.ndarray, sensor: TorqueSensorConfig
) -> np.ndarray:
    """Return cos and sin of each order (n, 2 m) through the mount, at each instant's frequency."""
    columns = np.empty((angle_rad.size, 2 * order.size))
    rigid = TorqueSensorConfig(resonance_Hz=sensor.resonance_Hz, damping_ratio=sensor.damping_ratio)
    for place, h in enumerate(order):
        seen = np.exp(1j * h * angle_rad)
        if sensor.resonance_Hz > 0:
            seen *= response(rigid, h * speed_rad_s / (2 * np.pi))
        columns[:, 2 * place], columns[:, 2 * place + 1] = seen.real, seen.imag
    return columns


def _counted_columns(
    order: np.ndarray, driven: Driven, angle_rad: np.ndarray, sensor: TorqueSensorConfig
) -> np.ndarray:
    """Return cos and sin of each order (n, 2 m) of the counted angle, through the mount in time."""
    gain = cell_gain(order, driven.grid) if driven.grid else np.ones(order.size)
    waves = gain * np.exp(1j * np.outer(angle_rad, order))
    columns = np.empty((angle_rad.size, 2 * order.size))
    columns[:, 0::2], columns[:, 1::2] = waves.real, waves.imag
    if sensor.resonance_Hz > 0:
        columns = passed_by_mount(columns, driven.period_s, sensor)
    return columns


def _visits(angle_rad: np.ndarray, turn: np.ndarray, counts: int) -> np.ndarray:
    """Return the first sample of each stay (m,) within one cell of the encoder, and one turn."""
    cell = np.rint(angle_rad * (counts / (2 * np.pi)))
    return np.flatnonzero((np.diff(cell, prepend=np.nan) != 0) | (np.diff(turn, prepend=-1) != 0))


def _by_turn(turns: Sequence[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples of whole turns, and the number of the turn of each."""
    rows = np.concatenate([np.arange(first, end) for first, end in turns])
    return rows, np.repeat(np.arange(len(turns)), [end - first for first, end in turns])


def _without_trend(columns: np.ndarray, t_s: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return columns (n, m) less their mean and slope in time over each turn."""
    free = np.empty_like(columns)
    edges = np.append(np.flatnonzero(np.diff(turn, prepend=-1)), turn.size)
    for first, end in pairwise(edges):
        part = columns[first:end] - columns[first:end].mean(axis=0)
        time = t_s[first:end] - t_s[first:end].mean()
        free[first:end] = part - np.outer(time, time @ part / (time @ time))
    return free


def _spectrum(
    angle_rad: np.ndarray,
    fit: ClusterFit,
    driven: Driven,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    highest: int,
) -> np.ndarray:
    """Return the lines of the residual at orders 1 to `highest`, before the sensor."""
    cell = np.rint(angle_rad * (motor.counts / (2 * np.pi))).astype(np.int64) % motor.counts
    order = np.arange(1, highest + 1)
    seen = response(sensor, order * driven.speed_Hz) * cell_gain(order, motor.counts)
    if driven.direction < 0:
        seen = seen.conj()
    return np.asarray(lines_at(cell, fit.residual, motor.counts, highest)[1:] / seen)


def _noise(spectrum_Nm: np.ndarray, fitted: np.ndarray, width: int = 41) -> np.ndarray:
    """Return the level of noise per component (m,), from the median of neighbouring orders.

    The size of a line of noise alone has the median 1.177 times that of each component.
    """
    size = np.abs(spectrum_Nm)
    size[fitted - 1] = np.nan
    half = min(width, size.size) // 2
    known = np.pad(np.where(np.isfinite(size), size, np.nan), half, constant_values=np.nan)
    near = np.sort(sliding_window_view(known, 2 * half + 1), axis=1)  # nan last
    number = np.isfinite(near).sum(axis=1, keepdims=True)
    middle = np.hstack([np.maximum(number - 1, 0) // 2, number // 2])
    level = np.take_along_axis(near, middle, axis=1).mean(axis=1)
    level[~np.isfinite(level)] = np.nanmedian(size) if np.isfinite(size).any() else 0.0
    return np.asarray(np.maximum(level / 1.177, 1e-300))
