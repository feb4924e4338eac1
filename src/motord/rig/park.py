"""Park transform in the frame of the simulated drive, as the drive has it; compiled.

The drive sees its d axis at an electrical angle of its own, `axes_sign` times pole pairs times the
angle of the rotor plus `axes_rad`, and its phases follow each other with that angle: where its own
positive direction is the rig's negative one, its phases b and c are the rig's c and b.
"""

import math

import numpy as np

from motord.jit import jit

PHASES, TURNING, LATCHED = 0, 1, 2
"""What the drive's commands are: phase currents; d and q, held along the rotor's axes; d and q,
made into phase currents once, when they arrive."""

_STEP_RAD = 2.0 * math.pi / 3.0


@jit
def d_axis_angle(p: np.record, angle_rad: float, speed_rad_s: float) -> float:
    """Return the electrical angle at which the drive has its d axis, with the rotor there."""
    return float(
        p.axes_sign * p.axes_pole_pairs * (angle_rad - p.axes_age_s * speed_rad_s)
    ) + float(p.axes_rad)


@jit
def dq_to_abc(p: np.record, axis_rad: float, d: float, q: float, values: np.ndarray) -> None:
    """Set `values` (3,) to what (d, q) are with the d axis at `axis_rad`."""
    for phase in range(3):
        own_rad = axis_rad - p.axes_order * phase * _STEP_RAD
        values[phase] = d * math.cos(own_rad) - q * math.sin(own_rad)


@jit
def abc_to_dq(p: np.record, axis_rad: float, values: np.ndarray) -> tuple[float, float]:
    """Return (d, q) of the phase values (3,) with the d axis at `axis_rad`."""
    d, q = 0.0, 0.0
    for phase in range(3):
        own_rad = axis_rad - p.axes_order * phase * _STEP_RAD
        d += values[phase] * math.cos(own_rad)
        q -= values[phase] * math.sin(own_rad)
    return 2.0 / 3.0 * d, 2.0 / 3.0 * q


@jit
def add_rotation(p: np.record, axis_rad: float, speed_rad_s: float, s: np.record) -> None:
    """Make `i_slope_A_per_s` of the state, (d, q, -) as the axes see it, that of the phases."""
    d, q = abc_to_dq(p, axis_rad, s.i_loop_A)
    turning_rad_s = p.axes_sign * p.axes_pole_pairs * speed_rad_s
    d_slope = s.i_slope_A_per_s[0] - turning_rad_s * q
    q_slope = s.i_slope_A_per_s[1] + turning_rad_s * d
    dq_to_abc(p, axis_rad, d_slope, q_slope, s.i_slope_A_per_s)


@jit
def latch(parameters: np.ndarray, state: np.ndarray, i_A: np.ndarray) -> None:
    """Make of `i_A` (3,), which is (d, q, -) as the drive says it, the phase currents for now."""
    p, s = parameters[0], state[0]
    axis_rad = d_axis_angle(p, s.angle_rad + s.remainder_s * s.speed_rad_s, s.speed_rad_s)
    dq_to_abc(p, axis_rad, i_A[0] / p.axes_scale, i_A[1] / p.axes_scale, i_A)


@jit
def sense_dq(p: np.record, s: np.record, o: np.record) -> None:
    """Fill i_d_A, i_q_A, u_d_V, u_q_V with what is sensed of the phases, as the drive says it."""
    age_s = p.axes_age_s if p.axes == TURNING else 0.0
    angle_rad = s.angle_rad + (s.remainder_s - age_s) * s.speed_rad_s
    axis_rad = float(p.axes_sign * p.axes_pole_pairs * angle_rad + p.axes_rad)
    d, q = abc_to_dq(p, axis_rad, o.i_sensed_A)
    o.i_d_A, o.i_q_A = p.axes_scale * d, p.axes_scale * q
    d, q = abc_to_dq(p, axis_rad, o.u_V)
    o.u_d_V, o.u_q_V = p.axes_scale * d, p.axes_scale * q
