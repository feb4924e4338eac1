"""Free decay of a rotor between springs, fitted whole: x'' = -w^2 x (1 + c x^2) - d x' - f sign x'.

Least squares over the path that is integrated by Runge-Kutta (compiled): frequency at small
amplitude, its change with the amplitude, viscous and Coulomb friction.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.optimize import least_squares

from motord.identification import IdentifyError
from motord.identification.rotor.log_decrement import FreeOscillation, five_periods
from motord.jit import jit

GEOMETRY = -2 / 3
"""Cubic part of sin x cos x."""

PARAMETERS = 7

ROUGHEST = 0.05
"""Largest residual of a fit that counts as one, in parts of the oscillation's width."""


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
def free_decay_angles(
    t_s: np.ndarray, p: np.ndarray, waves: np.ndarray, angle_rad: np.ndarray
) -> None:
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


@dataclass(frozen=True)
class Decay:
    """A fitted decay: x'' = -w^2 x (1 + cubic x^2 ...) - viscous x' - coulomb sign(x') [+ cogging].

    frequency_stderr_rad_s: standard error; residual_rad (n,) at t_s, angle_rad (n,) of the
    oscillation that were used.
    """

    frequency_rad_s: float
    frequency_stderr_rad_s: float
    rest_rad: float
    cubic_per_rad2: float
    viscous_per_s: float
    coulomb_rad_s2: float
    t_s: np.ndarray
    angle_rad: np.ndarray
    residual_rad: np.ndarray


def fit_decay(
    oscillation: FreeOscillation, stiffness_Nm: float, cogging_Nm: np.ndarray | None = None
) -> Decay:
    """Fit a decay from its first crossing on. Raises IdentifyError where it does not converge.

    cogging_Nm (3, n): order, cosine and sine of the cogging torque over encoder angle, if there is
    any; stiffness_Nm: of all springs against rotation, which makes accelerations of it.
    """
    t_s, angle_rad = oscillation.t_s[oscillation.used], oscillation.angle_rad[oscillation.used]
    t_s = t_s - t_s[0]
    start = _start(oscillation, angle_rad)
    scale = _scale(start)
    torques = np.zeros((3, 0)) if cogging_Nm is None else cogging_Nm
    model = np.empty_like(angle_rad)

    def residual(z: np.ndarray) -> np.ndarray:
        p = start + scale * z
        waves = torques.copy()
        waves[1:] *= p[SQUARE] / stiffness_Nm  # torque over inertia
        free_decay_angles(t_s, p, waves, model)
        return np.asarray((model - angle_rad) / oscillation.resolution_rad)

    fitted = least_squares(residual, np.zeros(start.size), max_nfev=60)
    rms_counts = float(np.sqrt(np.mean(fitted.fun**2)))
    if (
        not fitted.success
        or not rms_counts < ROUGHEST * np.ptp(angle_rad) / oscillation.resolution_rad
    ):
        raise IdentifyError(
            "a release could not be fitted; is it an oscillation about one rest angle?"
        )
    p = start + scale * fitted.x
    errors = _standard_errors(fitted.jac, fitted.fun) * scale
    w_rad_s = sqrt(p[SQUARE])
    return Decay(
        frequency_rad_s=w_rad_s,
        frequency_stderr_rad_s=float(errors[SQUARE]) / (2 * w_rad_s),
        rest_rad=float(p[REST]),
        cubic_per_rad2=float(p[TENSION]) + GEOMETRY,
        viscous_per_s=float(p[VISCOUS]),
        coulomb_rad_s2=float(p[COULOMB]),
        t_s=t_s,
        angle_rad=angle_rad,
        residual_rad=fitted.fun * oscillation.resolution_rad,
    )


def _start(oscillation: FreeOscillation, angle_rad: np.ndarray) -> np.ndarray:
    """Return parameters to start from: a damped cosine."""
    seen = five_periods(oscillation)
    frequency_rad_s = seen.frequency_rad_s()
    p = np.zeros(PARAMETERS)
    p[REST], p[SQUARE] = oscillation.rest_rad, frequency_rad_s**2
    p[VISCOUS] = 2 * seen.damping_ratio * frequency_rad_s
    p[X] = angle_rad[0] - oscillation.rest_rad
    # a quarter of a period before its first turning point, less what damping takes meanwhile
    p[SPEED] = oscillation.turns_rad[0] * frequency_rad_s * np.exp(seen.decrement / 4)
    return p


def _scale(start: np.ndarray) -> np.ndarray:
    """Return by how much parameters may be expected to be off."""
    w2 = start[SQUARE]
    size_rad = abs(start[SPEED]) / sqrt(w2)
    scale = np.empty_like(start)
    scale[[X, REST]] = 0.01 * size_rad
    scale[SPEED] = 0.01 * abs(start[SPEED])
    scale[SQUARE] = 1e-3 * w2
    scale[TENSION] = 0.01 / size_rad**2
    scale[VISCOUS] = 0.01 * sqrt(w2)
    scale[COULOMB] = 1e-3 * w2 * size_rad
    return scale


def _standard_errors(jacobian: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Return standard errors (p,); infinite where the data cannot separate parameters."""
    _, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    if s[-1] < 1e-10 * s[0]:
        return np.full(jacobian.shape[1], np.inf)
    variance = float(residual @ residual) / max(residual.size - jacobian.shape[1], 1)
    return np.asarray(np.sqrt(variance * ((vt / s[:, None]) ** 2).sum(axis=0)))


def mean_frequency(decays: Sequence[Decay]) -> tuple[float, float]:
    """Return the mean frequency (rad/s) and its standard error.

    Scatter averages out. The standard error of one fit does not: it comes from the encoder's
    rounding, which is alike for releases that are alike.
    """
    values = np.array([d.frequency_rad_s for d in decays])
    rounding = sqrt(float(np.mean([d.frequency_stderr_rad_s**2 for d in decays])))
    scatter = float(values.std(ddof=1)) if values.size > 1 else 0.0
    return float(values.mean()), sqrt(rounding**2 + scatter**2 / values.size)
