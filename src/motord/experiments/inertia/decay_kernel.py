"""The motion of a bar between springs, with friction and cogging torque; compiled."""

import math

import numpy as np

from motord.jit import jit

STEP_MAX_S = 1e-3
"""Longest step of the integration."""

X, SPEED, REST, SQUARE, TENSION, VISCOUS, COULOMB = range(7)
"""Places in the parameters: x and dx/dt at the first sample, rest angle, w^2, what the springs'
tension adds to the stiffness (1/rad^2), and friction over inertia: viscous (1/s), Coulomb
(rad/s^2)."""


@jit
def acceleration(
    p: np.ndarray, waves: np.ndarray, x_rad: float, speed_rad_s: float, sign: float
) -> float:
    """Return d2x/dt2; `sign` is the direction of motion, for Coulomb friction.

    Long springs square to the bar pull it back by K sin x cos x; how much their tension adds with
    the square of x depends on their length.
    waves (3, n): order, cosine and sine of the cogging torque over inertia (rad/s^2).
    """
    lever = math.sin(x_rad) * math.cos(x_rad)
    pull = -float(p[SQUARE]) * lever * (1.0 + p[TENSION] * x_rad * x_rad)
    total = pull - p[VISCOUS] * speed_rad_s - p[COULOMB] * sign
    for n in range(waves.shape[1]):
        turned = waves[0, n] * (p[REST] + x_rad)
        total += waves[1, n] * math.cos(turned) + waves[2, n] * math.sin(turned)
    return float(total)


@jit
def _runge_kutta(
    p: np.ndarray, waves: np.ndarray, x: float, v: float, sign: float, h: float
) -> tuple[float, float]:
    a1 = acceleration(p, waves, x, v, sign)
    v2 = v + 0.5 * h * a1
    a2 = acceleration(p, waves, x + 0.5 * h * v, v2, sign)
    v3 = v + 0.5 * h * a2
    a3 = acceleration(p, waves, x + 0.5 * h * v2, v3, sign)
    v4 = v + h * a3
    a4 = acceleration(p, waves, x + h * v3, v4, sign)
    return x + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4), v + h / 6.0 * (a1 + 2 * a2 + 2 * a3 + a4)


@jit
def swing_angles(t_s: np.ndarray, p: np.ndarray, waves: np.ndarray, angle_rad: np.ndarray) -> None:
    """Fill angle_rad (n,) with the angle at t_s (n,), which rises, for parameters p (7,).

    A step in which the direction of motion changes is split there.
    """
    x, v = p[X], p[SPEED]
    angle_rad[0] = p[REST] + x
    for n in range(1, t_s.size):
        span_s = t_s[n] - t_s[n - 1]
        steps = max(math.ceil(span_s / STEP_MAX_S - 1e-6), 1)
        h = span_s / steps
        for _ in range(steps):
            sign = math.copysign(1.0, v)
            x_after, v_after = _runge_kutta(p, waves, x, v, sign, h)
            if v_after * sign < 0.0:
                part = v / (v - v_after)
                x, v = _runge_kutta(p, waves, x, v, sign, part * h)
                x, v = _runge_kutta(p, waves, x, v, -sign, (1.0 - part) * h)
            else:
                x, v = x_after, v_after
        angle_rad[n] = p[REST] + x
