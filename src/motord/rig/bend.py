"""Nonlinearity of the current sensors, compiled: what a sensed current i* stands for.

Sensed i* stands for bent(i*) = i* + amplitude sin(wave i* + phase), which gain and offset make
flow. The slope stays between 1/2 and 3/2 (`truth.MAX_SLOPE`), so Newton's method inverts it. Only
called where there is a nonlinearity (`p.nonlinear`).
"""

import math

import numpy as np

from motord.jit import jit

NEWTON_STEPS = 6
"""Steps from the linear answer to one that is right to rounding."""


@jit
def bent(p: np.record, phase: int, i_A: float) -> float:
    """Return what the sensed current `i_A` stands for (A)."""
    turned = p.bend_wave_rad_per_A * i_A + p.bend_phase_rad[phase]
    return float(i_A + p.bend_A[phase] * math.sin(turned))


@jit
def bent_slope(p: np.record, phase: int, i_A: float) -> float:
    """Return the derivative of `bent` at the sensed current `i_A`."""
    turned = p.bend_wave_rad_per_A * i_A + p.bend_phase_rad[phase]
    return float(1.0 + p.bend_A[phase] * p.bend_wave_rad_per_A * math.cos(turned))


@jit
def straightened(p: np.record, phase: int, stands_for_A: float) -> float:
    """Return the sensed current (A) that stands for `stands_for_A`."""
    i_A = stands_for_A
    for _ in range(NEWTON_STEPS):
        i_A += (stands_for_A - bent(p, phase, i_A)) / bent_slope(p, phase, i_A)
    return i_A


@jit
def bent_common_part(p: np.record, s: np.record, x: np.ndarray, offset: float, c: float) -> float:
    """Return the c that makes sum_p g_p bent_p(x_p + c) + offset zero; `c` is a first guess."""
    for _ in range(NEWTON_STEPS):
        flows_A, slope = offset, 0.0
        for phase in range(3):
            i_A = x[phase] + c
            flows_A += s.gain[phase] * bent(p, phase, i_A)
            slope += s.gain[phase] * bent_slope(p, phase, i_A)
        c -= flows_A / slope
    return c
