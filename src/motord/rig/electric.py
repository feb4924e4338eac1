"""Inverter and windings over one substep, compiled: dead time, current loops, bus limit.

Each loop forces its sensed current i* to the command as a first-order lag; what flows is
g i* + beta with g = alpha epsilon (Poels 2008, eq. (4.1)), or curve(i*) in place of i* where the
sensors are not linear (`rig.sensor_nonlinearity`). In a star what flows sums to zero, so the
loops force i* less its mean over the phases, and the mean c follows from
sum_p (g_p i*_p + beta_p) = 0.
"""

import math

import numpy as np

from motord.jit import jit
from motord.rig.departures import mixed
from motord.rig.faults import disturbed_currents
from motord.rig.park import TURNING, abc_to_dq, add_rotation, d_axis_angle, dq_to_abc
from motord.rig.sensor_nonlinearity import (
    sensed_zero_sequence,
    sensor_curve,
    sensor_inverse,
    sensor_slope,
)
from motord.rig.types import QUEUE_LENGTH


@jit
def take_command(p: np.record, s: np.record, i_command_A: np.ndarray) -> None:
    """Queue `i_command_A` (3,), if it is new, to take effect after the dead time."""
    same = True
    for phase in range(3):
        i_A = i_command_A[phase]
        i_A = min(max(i_A, -p.current_max_A), p.current_max_A) if math.isfinite(i_A) else 0.0
        same = same and i_A == s.i_newest_A[phase]
        s.i_newest_A[phase] = i_A
    if same:
        return
    if s.queue_size < QUEUE_LENGTH:
        s.queue_size += 1
        last = (s.queue_head + s.queue_size - 1) % QUEUE_LENGTH
        s.queue_step[last] = s.step + s.remainder_s / p.substep_s + p.dead_steps
    last = (s.queue_head + s.queue_size - 1) % QUEUE_LENGTH
    for phase in range(3):
        s.queue_A[3 * last + phase] = s.i_newest_A[phase]


@jit
def _next_command(p: np.record, s: np.record) -> None:
    """Put the oldest queued command in force; of phases in a star without its common part."""
    first = 3 * s.queue_head
    common_A, unit = 0.0, 1.0
    if p.axes == TURNING:
        unit = float(p.axes_scale)
    elif p.star:
        common_A = (s.queue_A[first] + s.queue_A[first + 1] + s.queue_A[first + 2]) / 3.0
    for phase in range(3):
        s.i_command_A[phase] = s.queue_A[first + phase] / unit - common_A
    if p.current_crosstalk:
        _unmix_command(p, s)
    s.queue_head = (s.queue_head + 1) % QUEUE_LENGTH
    s.queue_size -= 1


@jit
def _unmix_command(p: np.record, s: np.record) -> None:
    """Make of the command what the loops force, so that the sensors' readings follow it."""
    command_A = s.i_command_A
    a_A = mixed(p.current_unmixed, command_A, 0)
    b_A = mixed(p.current_unmixed, command_A, 1)
    c_A = mixed(p.current_unmixed, command_A, 2)
    common_A = (a_A + b_A + c_A) / 3.0 if p.star else 0.0
    command_A[0], command_A[1], command_A[2] = a_A - common_A, b_A - common_A, c_A - common_A


@jit
def _track(s: np.record, decay: float) -> None:
    """Let the controlled currents approach the command; `decay`: part of the error that remains."""
    for phase in range(3):
        command_A = s.i_command_A[phase]
        s.i_loop_A[phase] = command_A + (s.i_loop_A[phase] - command_A) * decay


@jit
def _run_loops(p: np.record, s: np.record) -> None:
    """Run the loops over one substep, through commands that take effect on the way (exact)."""
    position = 0.0
    while s.queue_size > 0 and s.queue_step[s.queue_head] < s.step + 1:
        at = max(s.queue_step[s.queue_head] - s.step, position)
        _track(s, math.exp(-p.loop_rate_per_s * p.substep_s * (at - position)))
        _next_command(p, s)
        position = at
    rest = p.loop_decay
    if position > 0.0:
        rest = math.exp(-p.loop_rate_per_s * p.substep_s * (1.0 - position))
    _track(s, rest)


@jit
def _run_turning_loops(p: np.record, s: np.record, speed_rad_s: float) -> None:
    """As `_run_loops`, for commands along axes that turn by a substep meanwhile."""
    loop_A = s.i_loop_A
    before_rad = d_axis_angle(p, s.angle_rad, speed_rad_s)
    loop_A[0], loop_A[1] = abc_to_dq(p, before_rad, loop_A)
    _run_loops(p, s)
    after_rad = d_axis_angle(p, s.angle_rad + p.substep_s * speed_rad_s, speed_rad_s)
    dq_to_abc(p, after_rad, loop_A[0], loop_A[1], loop_A)


@jit
def _linear_common_part(g: np.ndarray, x: np.ndarray, offset: float) -> float:
    """Return the c that makes sum_p g_p (x_p + c) + offset zero."""
    total = float(g[0] * x[0] + g[1] * x[1] + g[2] * x[2] + offset)
    return -total / float(g[0] + g[1] + g[2])


@jit
def limit_voltages(
    p: np.record, u_a: float, u_b: float, u_c: float
) -> tuple[float, float, float, bool]:
    """Return winding voltages (V) that the bus allows, and whether that changed them.

    Independent windings have a bridge each: +-bus. In a star no two may differ by more than the
    bus; their common part belongs to the floating neutral and stays.
    """
    bus_V = p.bus_V
    if p.star:
        span_V = max(u_a, u_b, u_c) - min(u_a, u_b, u_c)
        if span_V <= bus_V:
            return u_a, u_b, u_c, False
        mean_V, scale = (u_a + u_b + u_c) / 3.0, bus_V / span_V
        u_a, u_b = mean_V + (u_a - mean_V) * scale, mean_V + (u_b - mean_V) * scale
        return u_a, u_b, mean_V + (u_c - mean_V) * scale, True
    if max(abs(u_a), abs(u_b), abs(u_c)) <= bus_V:
        return u_a, u_b, u_c, False
    u_a, u_b = min(max(u_a, -bus_V), bus_V), min(max(u_b, -bus_V), bus_V)
    return u_a, u_b, min(max(u_c, -bus_V), bus_V), True


@jit
def _mean_voltage(p: np.record, s: np.record, phase: int, i_A: float, speed_rad_s: float) -> float:
    """Return R i + L di/dt + k w, the mean over a substep in which the current becomes `i_A`."""
    before_A = float(s.i_A[phase])
    slope_V = p.inductance_H / p.substep_s * (i_A - before_A)
    emf_V = float(s.k_V_s_per_rad[phase]) * speed_rad_s
    return float(0.5 * s.resistance_ohm[phase] * (i_A + before_A) + slope_V + emf_V)


@jit
def _under_voltage(p: np.record, s: np.record, phase: int, u_V: float, speed_rad_s: float) -> float:
    """Return the current (A) after a substep of `u_V` on R, L and the back-EMF (trapezoidal)."""
    rate_ohm = float(p.inductance_H / p.substep_s)
    drive_V = u_V - float(s.k_V_s_per_rad[phase]) * speed_rad_s
    half_ohm = 0.5 * float(s.resistance_ohm[phase])
    return float((rate_ohm - half_ohm) * s.i_A[phase] + drive_V) / (rate_ohm + half_ohm)


@jit
def _flowing(p: np.record, s: np.record, phase: int, sensed_A: float) -> float:
    """Return what flows (A) where `sensed_A` is sensed."""
    if p.nonlinear:
        sensed_A = sensor_curve(p, phase, sensed_A)
    return float(s.gain[phase] * sensed_A + p.beta_A[phase])


@jit
def _flow(p: np.record, s: np.record, speed_rad_s: float) -> None:
    """Let the currents flow that the loops ask for, as far as the bus voltage allows."""
    common_A = 0.0
    if p.star:  # so that what flows sums to zero
        offset_A = p.beta_A[0] + p.beta_A[1] + p.beta_A[2]
        common_A = _linear_common_part(s.gain, s.i_loop_A, offset_A)
        if p.nonlinear:
            common_A = sensed_zero_sequence(p, s, s.i_loop_A, offset_A, common_A)
    i_a = _flowing(p, s, 0, s.i_loop_A[0] + common_A)
    i_b = _flowing(p, s, 1, s.i_loop_A[1] + common_A)
    i_c = _flowing(p, s, 2, s.i_loop_A[2] + common_A)
    u_a, u_b, u_c, limited = limit_voltages(
        p,
        _mean_voltage(p, s, 0, i_a, speed_rad_s),
        _mean_voltage(p, s, 1, i_b, speed_rad_s),
        _mean_voltage(p, s, 2, i_c, speed_rad_s),
    )
    if limited:
        i_a = _under_voltage(p, s, 0, u_a, speed_rad_s)
        i_b = _under_voltage(p, s, 1, u_b, speed_rad_s)
        i_c = _under_voltage(p, s, 2, u_c, speed_rad_s)
        _set_flow(p, s, i_a, i_b, i_c)
    else:
        s.i_A[0], s.i_A[1], s.i_A[2] = i_a, i_b, i_c
        for phase in range(3):
            s.i_sensed_A[phase] = s.i_loop_A[phase] + common_A


@jit
def _set_flow(p: np.record, s: np.record, i_a: float, i_b: float, i_c: float) -> None:
    """Set what flows, and from it what is sensed and what the loops control."""
    s.i_A[0], s.i_A[1], s.i_A[2] = i_a, i_b, i_c
    for phase in range(3):
        sensed_A = float((s.i_A[phase] - p.beta_A[phase]) / s.gain[phase])
        s.i_sensed_A[phase] = sensor_inverse(p, phase, sensed_A) if p.nonlinear else sensed_A
    common_A = 0.0
    if p.star:
        common_A = (s.i_sensed_A[0] + s.i_sensed_A[1] + s.i_sensed_A[2]) / 3.0
    for phase in range(3):
        s.i_loop_A[phase] = s.i_sensed_A[phase] - common_A


@jit
def _flow_disturbed(p: np.record, s: np.record, speed_rad_s: float) -> None:
    """As `_flow`, with an open phase or one that runs away (`rig.faults`)."""
    before_a, before_b, before_c = s.i_A[0], s.i_A[1], s.i_A[2]
    _flow(p, s, speed_rad_s)
    after_a, after_b, after_c = s.i_A[0], s.i_A[1], s.i_A[2]
    s.i_A[0], s.i_A[1], s.i_A[2] = before_a, before_b, before_c
    i_a, i_b, i_c = disturbed_currents(p, s, after_a, after_b, after_c)
    _set_flow(p, s, i_a, i_b, i_c)
    if s.tripped:
        s.wanted = 0


@jit
def _freewheel(p: np.record, s: np.record) -> None:
    """Switched off: the diodes put the bus against the currents until these have died away."""
    largest_A = max(abs(s.i_A[0]), abs(s.i_A[1]), abs(s.i_A[2]))
    scale = 0.0
    if largest_A > 0.0:
        scale = max(0.0, 1.0 - p.substep_s * p.bus_V / p.inductance_H / largest_A)
    _set_flow(p, s, s.i_A[0] * scale, s.i_A[1] * scale, s.i_A[2] * scale)


@jit
def step_currents(p: np.record, s: np.record, speed_rad_s: float) -> None:
    """Advance queue, power stage and currents by one substep at the mean speed of it."""
    s.on_steps = s.on_steps + 1 if s.wanted else 0
    s.inverter_on = 1 if s.on_steps > p.ready_steps else 0
    if p.axes == TURNING:
        _run_turning_loops(p, s, speed_rad_s)
    else:
        _run_loops(p, s)
    if s.inverter_on and s.injected.phase_open | s.injected.current_runaway:
        _flow_disturbed(p, s, speed_rad_s)
    elif s.inverter_on:
        _flow(p, s, speed_rad_s)
    else:
        _freewheel(p, s)


@jit
def _set_slopes(p: np.record, s: np.record) -> None:
    """Set how fast the loops change their currents now."""
    d, q, axis_rad = 0.0, 0.0, 0.0
    if p.axes == TURNING:
        axis_rad = d_axis_angle(p, s.angle_rad, s.speed_rad_s)
        d, q = abc_to_dq(p, axis_rad, s.i_loop_A)
    for phase in range(3):
        error_A = s.i_command_A[phase] - s.i_loop_A[phase]
        s.i_slope_A_per_s[phase] = error_A * p.loop_rate_per_s if s.inverter_on else 0.0
    if p.axes == TURNING and s.inverter_on:
        s.i_slope_A_per_s[0] = (s.i_command_A[0] - d) * p.loop_rate_per_s
        s.i_slope_A_per_s[1] = (s.i_command_A[1] - q) * p.loop_rate_per_s
        add_rotation(p, axis_rad, s.speed_rad_s, s)


@jit
def winding_voltages(p: np.record, s: np.record) -> tuple[float, float, float]:
    """Return the voltages (V) across the windings now: R i + L di/dt + k w."""
    slope, gain = s.i_slope_A_per_s, s.gain_now
    _set_slopes(p, s)
    for phase in range(3):
        gain[phase] = s.gain[phase]
        if p.nonlinear:
            gain[phase] *= sensor_slope(p, phase, s.i_sensed_A[phase])
    common = _linear_common_part(gain, slope, 0.0) if p.star else 0.0
    w, k, r, inductance = s.speed_rad_s, s.k_V_s_per_rad, s.resistance_ohm, p.inductance_H
    u_a = r[0] * s.i_A[0] + inductance * gain[0] * (slope[0] + common) + k[0] * w
    u_b = r[1] * s.i_A[1] + inductance * gain[1] * (slope[1] + common) + k[1] * w
    u_c = r[2] * s.i_A[2] + inductance * gain[2] * (slope[2] + common) + k[2] * w
    u_a, u_b, u_c, _ = limit_voltages(p, u_a, u_b, u_c)
    return u_a, u_b, u_c
