"""Departures of a real bench from the controller's model, compiled; each only where asked for.

Encoder: theta + sum_m e_m sin(m theta + phi_m) is read. Torque sensor: T (1 + sum_m c_m sin(m theta
+ phi_m)). Friction: the sum of its ripple's orders works against the motion. Back-EMF and cogging
torque are scaled by 1 - drop i and 1 + rise i, with i the amplitude of balanced phase currents of
the same heat; the back-EMF also by 1 + c (T - T_0) of the magnets. Current sensors: the sensor of
phase p reads sum_q (delta_pq + x_pq) i*_q.
"""

import math

import numpy as np

from motord.jit import jit


@jit
def harmonic_sum(harmonics: np.record, angle_rad: float) -> float:
    """Return the sum of amplitude sin(order angle + phase) over the harmonics in use."""
    total = 0.0
    for n in range(harmonics.terms):
        turned_rad = harmonics.orders[n] * angle_rad + harmonics.phase_rad[n]
        total += harmonics.amplitude[n] * math.sin(turned_rad)
    return total


@jit
def scales_by_load(p: np.record, s: np.record) -> tuple[float, float]:
    """Return the factors of back-EMF and cogging torque now: by currents, magnets' temperature."""
    warm = 1.0 + p.back_emf_per_K * (s.magnet_C - p.ambient_C)
    i = s.i_A
    amplitude_A = math.sqrt((i[0] * i[0] + i[1] * i[1] + i[2] * i[2]) * (2.0 / 3.0))
    return (
        max((1.0 - p.back_emf_drop_per_A * amplitude_A) * warm, 0.5),
        max(1.0 + p.cogging_rise_per_A * amplitude_A, 0.0),
    )


@jit
def friction_ripple_Nm(p: np.record, speed_rad_s: float, angle_rad: float) -> float:
    """Return the torque on the rotor of its friction's ripple; none while it rests."""
    if speed_rad_s == 0.0:
        return 0.0
    return -math.copysign(1.0, speed_rad_s) * harmonic_sum(p.friction_ripple, angle_rad)


@jit
def sensor_load_Nm(p: np.record, torque_Nm: float, angle_rad: float) -> float:
    """Return what the torque sensor is loaded with, cross-talk included."""
    return float(torque_Nm * (1.0 + harmonic_sum(p.torque_crosstalk, angle_rad)))


@jit
def mixed(matrix: np.ndarray, i_A: np.ndarray, phase: int) -> float:
    """Return a row of a 3 x 3 `matrix` (9,) times the currents (3,)."""
    row = 3 * phase
    return float(matrix[row] * i_A[0] + matrix[row + 1] * i_A[1] + matrix[row + 2] * i_A[2])
