"""Programmed reference currents, limits and ramp, in compiled code.

Least-copper-loss currents from the back-EMF table (Poels 2008, ch. 4; docs/methods.md, section 2):

- independent phases: i_p = T k_p / sum_q k_q^2
- star:               i_p = T m_p / sum_q m_q^2,  m_p = k_p - mean_q k_q

Compensation is `step`'s: T less the cogging torque at the angle where the current will flow, then
the inverse of the current errors, i_cmd = (i - beta) / (alpha delta_epsilon). For a drive that
makes current along q alone `currents_along_q` has both current errors in it.
"""

import math

import numpy as np

from motord.control.observer import TWO_PI
from motord.control.park import dq_to_abc
from motord.jit import jit

TINY_V2_S2 = 1e-12
"""Sum of squared back-EMF constants below which no current makes torque."""


@jit
def table_position(angle_rad: float, counts: int) -> tuple[int, int, float]:
    """Return (index, next index, weight of the next) of `angle_rad` in a table of one turn.

    The table has no end: after its last point comes the first again.
    """
    position = angle_rad / TWO_PI * counts
    floor = math.floor(position)
    index = int(floor) % counts
    return index, (index + 1) % counts, position - floor


@jit
def phase_currents(
    torque_Nm: float, k_a: float, k_b: float, k_c: float, star: int
) -> tuple[float, float, float]:
    """Return the three currents (A) that make `torque_Nm` with back-EMF constants k (V s/rad)."""
    if star:
        mean = (k_a + k_b + k_c) / 3.0
        k_a, k_b, k_c = k_a - mean, k_b - mean, k_c - mean
    power = k_a * k_a + k_b * k_b + k_c * k_c
    if not power > TINY_V2_S2:
        return 0.0, 0.0, 0.0
    scale = torque_Nm / power
    return scale * k_a, scale * k_b, scale * k_c


@jit
def currents_along_q(
    p: np.record, compensate: bool, torque_Nm: float, angle_rad: float, k: tuple[float, ...]
) -> tuple[float, float, float]:
    """Return the currents (A) that make `torque_Nm`, of which those there are with d at zero.

    For a star and a drive that makes current along q alone: in phase p flows g_p (x_p + c) + beta_p
    where x_p was commanded, and c is such that nothing is left over. So the torque is
    sum_p (k_p - kappa) (g_p x_p + beta_p), kappa = sum_p g_p k_p / sum_p g_p. `compensate`: with
    gains and offsets of the calibration, else with 1 and 0. k (3,): back-EMF constants (V s/rad).
    """
    electrical_rad = p.pole_pairs * angle_rad + p.axes_rad
    x_a, x_b, x_c = dq_to_abc(electrical_rad, p.axes_sequence, 0.0, 1.0)
    g_a, g_b, g_c, offset_Nm = 1.0, 1.0, 1.0, 0.0
    if compensate:
        common = p.delta_epsilon
        g_a, g_b, g_c = p.alpha[0] * common, p.alpha[1] * common, p.alpha[2] * common
    kappa = (g_a * k[0] + g_b * k[1] + g_c * k[2]) / (g_a + g_b + g_c)
    m_a, m_b, m_c = k[0] - kappa, k[1] - kappa, k[2] - kappa
    if compensate:
        offset_Nm = m_a * p.beta_A[0] + m_b * p.beta_A[1] + m_c * p.beta_A[2]
    torque_per_A = m_a * g_a * x_a + m_b * g_b * x_b + m_c * g_c * x_c
    if not torque_per_A * torque_per_A > TINY_V2_S2:
        return 0.0, 0.0, 0.0
    i_q = (torque_Nm - offset_Nm) / torque_per_A
    return i_q * x_a, i_q * x_b, i_q * x_c


@jit
def limit_currents(
    i_a: float, i_b: float, i_c: float, limit_A: float
) -> tuple[float, float, float, float]:
    """Return the currents scaled together so that none exceeds `limit_A`, and the scale.

    That is 1 within the limit; 0 if they are not finite.
    """
    largest = max(abs(i_a), abs(i_b), abs(i_c))
    if not (math.isfinite(i_a) and math.isfinite(i_b) and math.isfinite(i_c)):
        return 0.0, 0.0, 0.0, 0.0
    if largest <= limit_A:
        return i_a, i_b, i_c, 1.0
    scale = limit_A / largest * (1.0 - 1e-6)  # below the limit in single precision, too
    return i_a * scale, i_b * scale, i_c * scale, scale


@jit
def clamp(value: float, limit: float) -> float:
    """Return `value` within +-limit; zero for what is not a number."""
    if math.isnan(value):
        return 0.0
    return min(max(value, -limit), limit)


@jit
def ramp(value: float, target: float, step: float) -> float:
    """Return `value` moved towards `target` by at most `step`."""
    return target if abs(target - value) <= step else value + math.copysign(step, target - value)
