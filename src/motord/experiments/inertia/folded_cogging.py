"""Aliased cogging torque, taken out of the samples of a step and replaced by what acts.

An order that passes about as fast as the loop samples is folded down to a slow torque, which does
not act and which integrals take for one. Near its resonance the mount enlarges it. By the
encoder's angle the waves of an order are known between the samples as well:

    T' = T - a g + a c

g (sampled) is what the mount passes on of cos m theta and sin m theta, c their mean over the period
around each sample, which is what acts; the amplitudes a are fitted to T next to a smooth torque.
"""

from collections.abc import Sequence
from math import ceil

import numpy as np

from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification.orders import (
    COUNTS_PER_COGGING_ORDER,
    MAIN_MULTIPLES,
    SAMPLES_PER_COGGING_ORDER,
    main_order,
)
from motord.identification.torque.torque_sensor import passed_by_mount

SMOOTH_DEGREE = 16
"""Degree of the polynomial in time that stands for all other torque where amplitudes are fitted."""

SPEED_PIECES = 40
"""Pieces of a step whose mean speeds tell its highest one: single counts would overrate it."""

FINE_SAMPLES = 10
"""Times at which a period of the highest order is followed."""

SAMPLES_PER_TERM = 4
"""Samples of a step for each amplitude that is fitted, at least."""


def main_orders(motor: MotorConfig) -> tuple[int, ...]:
    """Return the main cogging order and its multiples that the encoder resolves."""
    main = main_order(motor.slots, 2 * motor.pole_pairs)
    orders = (main * n for n in range(1, MAIN_MULTIPLES + 1))
    return tuple(one for one in orders if one <= motor.counts // COUNTS_PER_COGGING_ORDER)


def without_folded(
    t_s: np.ndarray,
    angle_rad: np.ndarray,
    torque_Nm: np.ndarray,
    sensor: TorqueSensorConfig,
    orders: Sequence[int],
) -> np.ndarray:
    """Return the torque (n,) with the orders that its samples do not resolve as they act."""
    period_s, top_Hz = float(np.median(np.diff(t_s))), _highest_speed_Hz(t_s, angle_rad)
    fast = [one for one in orders if SAMPLES_PER_COGGING_ORDER * one * top_Hz * period_s > 1]
    terms = 2 * len(fast) + SMOOTH_DEGREE + 1
    if not fast or t_s.size < SAMPLES_PER_TERM * terms:
        return torque_Nm
    pieces = 2 * ceil(FINE_SAMPLES * max(fast) * top_Hz * period_s / 2)
    place = np.arange((t_s.size - 1) * pieces + 1) / pieces
    fine_rad = np.interp(place, np.arange(t_s.size), angle_rad)
    waves = np.column_stack([wave(one * fine_rad) for one in fast for wave in (np.cos, np.sin)])
    waves -= waves[0]
    seen = passed_by_mount(waves, period_s / pieces, sensor) if sensor.resonance_Hz else waves
    smooth = np.polynomial.legendre.legvander(np.linspace(-1, 1, t_s.size), SMOOTH_DEGREE)
    seen = seen[::pieces]
    fitted, *_ = np.linalg.lstsq(np.column_stack([seen, smooth]), torque_Nm, rcond=None)
    amplitudes_Nm = fitted[: seen.shape[1]]
    return np.asarray(torque_Nm + (_means(waves, pieces) - seen) @ amplitudes_Nm)


def _highest_speed_Hz(t_s: np.ndarray, angle_rad: np.ndarray) -> float:
    piece = 1 + t_s.size // SPEED_PIECES
    speeds_rad_s = np.diff(angle_rad[::piece]) / np.diff(t_s[::piece])
    return float(np.abs(speeds_rad_s).max(initial=0.0)) / (2 * np.pi)


def _means(waves: np.ndarray, pieces: int) -> np.ndarray:
    """Return the means (n, k) of waves over the period around each sample, `pieces` apart."""
    steps = 0.5 * (waves[1:] + waves[:-1])
    sums = np.concatenate([np.zeros((1, waves.shape[1])), np.cumsum(steps, axis=0)])
    samples = np.arange(0, waves.shape[0], pieces)
    first = np.maximum(samples - pieces // 2, 0)
    last = np.minimum(samples + pieces // 2, waves.shape[0] - 1)
    return np.asarray((sums[last] - sums[first]) / (last - first)[:, None])
