"""Integral nonlinearity of the current sensors, compiled: sensed i* stands for curve(i*).

    curve(i*) = i* (1 + a i* + b i*^2) + amplitude sin(wave i* + phase)

Gain and offset make of it what flows. The slope stays between 1/2 and 3/2 (`truth.MAX_SLOPE`), so
Newton's method inverts it. Only called where there is a nonlinearity (`p.nonlinear`).
"""

import math

import numpy as np

from motord.jit import jit

NEWTON_STEPS = 6
"""Steps from the linear answer to one that is right to rounding."""


@jit
def sensor_curve(p: np.record, phase: int, i_A: float) -> float:
    """Return what the sensed current `i_A` stands for (A)."""
    turned = p.nonlinearity_rad_per_A * i_A + p.nonlinearity_phase_rad[phase]
    gain = 1.0 + i_A * (p.nonlinearity_per_A[phase] + i_A * p.nonlinearity_per_A2[phase])
    return float(i_A * gain + p.nonlinearity_A[phase] * math.sin(turned))


@jit
def sensor_slope(p: np.record, phase: int, i_A: float) -> float:
    """Return the derivative of `sensor_curve` at the sensed current `i_A`."""
    turned = p.nonlinearity_rad_per_A * i_A + p.nonlinearity_phase_rad[phase]
    a, b = p.nonlinearity_per_A[phase], p.nonlinearity_per_A2[phase]
    slope = 1.0 + i_A * (2.0 * a + 3.0 * b * i_A)
    return float(slope + p.nonlinearity_A[phase] * p.nonlinearity_rad_per_A * math.cos(turned))


@jit
def sensor_inverse(p: np.record, phase: int, stands_for_A: float) -> float:
    """Return the sensed current (A) that stands for `stands_for_A`."""
    i_A = stands_for_A
    for _ in range(NEWTON_STEPS):
        i_A += (stands_for_A - sensor_curve(p, phase, i_A)) / sensor_slope(p, phase, i_A)
    return i_A


@jit
def sensed_zero_sequence(
    p: np.record, s: np.record, x: np.ndarray, offset: float, c: float
) -> float:
    """Return the c that makes sum_p g_p curve_p(x_p + c) + offset zero; `c` is a first guess."""
    for _ in range(NEWTON_STEPS):
        flows_A, slope = offset, 0.0
        for phase in range(3):
            i_A = x[phase] + c
            flows_A += s.gain[phase] * sensor_curve(p, phase, i_A)
            slope += s.gain[phase] * sensor_slope(p, phase, i_A)
        c -= flows_A / slope
    return c
