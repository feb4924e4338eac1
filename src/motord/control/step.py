"""One tick of control: feedback and set-point in; command, memory and the tick record out.

Pure and compiled: no clock, no I/O, nothing that knows whether the rig is real. The caller has
filled `tick`, `missed`, `wake_late_ns`, `work_ns` and the flags of lateness in the tick record.
"""

import numpy as np

from motord.config.timing import DELAY_MAX_S, POSITION_AGE_MAX_S
from motord.control import interlocks, observer, reference, tracks
from motord.control.learned import learned_torque
from motord.control.plausible import remember_command
from motord.control.states import STATE, transition
from motord.control.types import MEMORY
from motord.jit import constants, jit
from motord.schema import INT32_MAX, BridgeStatus, Compensate, Flag, InverterStatus, Trip

_FLAG, _COMPENSATE = constants(Flag), constants(Compensate)
_BRIDGE, _INVERTER = constants(BridgeStatus), constants(InverterStatus)
_TRIP = constants(Trip)
FAST_BARS_NS = 100_000_000
"""For so long after its newest estimate above the limit the speed bars enabling and reset: between
two counts the estimate of a rotor that is too fast falls below it for a sample or two."""
OFF_NS = round(DELAY_MAX_S * 1e9)
"""Within this time of being disabled the drive is off."""

ELAPSED_MAX_S = 1.0
"""Most time that a tick counts for, however long the loop was kept from running before it."""


def new_memory() -> np.ndarray:
    """Return the memory of a kernel that has not run yet, shape (1,): OFF, nothing known."""
    return np.zeros(1, MEMORY)


@jit
def _i32(value: int) -> int:
    return min(max(value, -INT32_MAX), INT32_MAX)


@jit
def _set_torque(
    p: np.record, m: np.record, s: np.record, supervisor_late: bool, elapsed_s: float
) -> int:
    """Ramp the torque set-point; to zero unless enabled, asked for and supervised. Flags.

    A ramp down to zero goes on through missed ticks and ends within RAMP_DOWN_MAX_S.
    """
    if m.state != STATE.ENABLED:
        m.torque_set_Nm = 0.0
        return 0
    wanted_Nm = 0.0 if m.stopping or supervisor_late else float(s.torque_Nm)
    target_Nm = reference.clamp(wanted_Nm, p.torque_limit_Nm)
    step_Nm = p.torque_rate_Nm_per_s * p.period_s
    if target_Nm == 0.0:
        step_Nm = p.ramp_down_Nm_per_s * elapsed_s
    m.torque_set_Nm = reference.ramp(m.torque_set_Nm, target_Nm, step_Nm)
    flags = _FLAG.RAMPING if m.torque_set_Nm != target_Nm else 0
    return flags | (_FLAG.TORQUE_LIMITED if wanted_Nm != target_Nm else 0)


@jit
def _currents(
    p: np.record,
    m: np.record,
    s: np.record,
    back_emf: np.ndarray,
    cogging_Nm: np.ndarray,
    learned_Nm: np.ndarray,
    angle_rad: float,
    command: np.record,
    tick: np.record,
) -> int:
    """Fill the command's currents for the angle at which they will flow. Returns flags."""
    flags = 0
    n, following, weight = reference.table_position(angle_rad, p.counts)
    torque_Nm = m.torque_set_Nm
    if s.compensate & _COMPENSATE.COGGING:
        cog_Nm = (1.0 - weight) * cogging_Nm[n] + weight * cogging_Nm[following]
        cog_Nm *= 1.0 + s.induced_cogging
        tick.cogging_comp_Nm = cog_Nm
        torque_Nm -= cog_Nm
        flags |= _FLAG.COGGING_COMPENSATED
    if s.compensate & _COMPENSATE.LEARNED and p.learned_orders:
        speed_rad_s = m.speed_rad_s
        torque_Nm -= learned_torque(p, learned_Nm, m.torque_set_Nm, speed_rad_s, angle_rad)
        flags |= _FLAG.LEARNED_COMPENSATED
    wanted_Nm = torque_Nm
    torque_Nm = reference.clamp(wanted_Nm, p.torque_limit_Nm)
    if torque_Nm != wanted_Nm:
        flags |= _FLAG.TORQUE_LIMITED
    k_a = (1.0 - weight) * back_emf[n, 0] + weight * back_emf[following, 0]
    k_b = (1.0 - weight) * back_emf[n, 1] + weight * back_emf[following, 1]
    k_c = (1.0 - weight) * back_emf[n, 2] + weight * back_emf[following, 2]
    compensated = s.compensate & _COMPENSATE.CURRENTS != 0
    flags |= _FLAG.CURRENTS_COMPENSATED if compensated else 0
    if p.q_only:
        axes_rad = angle_rad - m.speed_rad_s * p.axes_age_s
        k = (k_a, k_b, k_c)
        i_a, i_b, i_c = reference.currents_along_q(p, compensated, torque_Nm, axes_rad, k)
    else:
        i_a, i_b, i_c = reference.phase_currents(torque_Nm, k_a, k_b, k_c, p.star)
    i_a = (1.0 + s.induced_gain[0]) * i_a + s.induced_offset_A[0]
    i_b = (1.0 + s.induced_gain[1]) * i_b + s.induced_offset_A[1]
    i_c = (1.0 + s.induced_gain[2]) * i_c + s.induced_offset_A[2]
    if compensated and not p.q_only:
        i_a = (i_a - p.beta_A[0]) / (p.alpha[0] * p.delta_epsilon)
        i_b = (i_b - p.beta_A[1]) / (p.alpha[1] * p.delta_epsilon)
        i_c = (i_c - p.beta_A[2]) / (p.alpha[2] * p.delta_epsilon)
    i_a, i_b, i_c, scale = reference.limit_currents(i_a, i_b, i_c, p.current_limit_A)
    command.i_A[0], command.i_A[1], command.i_A[2] = i_a, i_b, i_c
    m.torque_cut_Nm = max(m.torque_cut_Nm, (1.0 - scale) * abs(torque_Nm))
    return flags | (_FLAG.CURRENT_LIMITED if scale < 1.0 else 0)


@jit
def _powered(m: np.record, f: np.record) -> bool:
    """Return whether inverter and enable line are ready, by what they stated lately enough.

    A status from before the drive can have carried out that it was disabled says nothing of
    whether it is on again: the next one may show it off, which would be a fault once enabled.
    """
    stated_ns = f.t_status_ns if f.t_status_ns else f.t_inverter_ns
    ready = f.inverter_status & _INVERTER.READY and f.bridge_status & _BRIDGE.ENABLE_LINE
    return bool(ready != 0 and min(stated_ns, f.t_ns) >= m.off_by_ns)


@jit
def _bars(m: np.record, conditions: int, causes: int, now_ns: int) -> int:
    """Return what keeps OFF from being enabled and a trip from being reset."""
    if conditions & _TRIP.OVER_SPEED:
        m.fast_until_ns = now_ns + FAST_BARS_NS
    return int(causes | (_TRIP.OVER_SPEED if now_ns < m.fast_until_ns else 0))


@jit
def _decide(
    p: np.record,
    m: np.record,
    s: np.record,
    f: np.record,
    missed: int,
    new: int,
    supervisor_late: bool,
    elapsed_s: float,
) -> int:
    """Evaluate interlocks and the supervisor's request, move the state; returns what bars it."""
    request = 0
    if m.started and s.request_seq != m.request_seq:
        request = s.request
    m.request_seq = s.request_seq
    conditions = interlocks.conditions(
        p,
        m,
        f,
        missed,
        supervisor_late,
        s.brake_temperature_C,
        s.channels_beyond,
        s.i2t_derating,
    )
    bits = interlocks.debounced(p, m, conditions, new, f.now_ns)
    interlocks.latch(m, bits)
    bars = _bars(m, conditions, bits, f.now_ns)
    commanded_on = m.state == STATE.ENABLED or m.arming != 0
    state, arming, stopping = transition(
        m.state,
        m.arming != 0,
        m.stopping != 0,
        request,
        bars if m.state == STATE.OFF or m.state == STATE.TRIPPED else bits,
        _powered(m, f),
        m.torque_set_Nm == 0.0,
    )
    if commanded_on and not (state == STATE.ENABLED or arming):
        m.off_by_ns = f.now_ns + OFF_NS
    if m.state == STATE.TRIPPED and state == STATE.READY:
        m.trip_bits = 0
        m.first_trip = 0
    if state == STATE.READY and m.state in (STATE.OFF, STATE.TRIPPED):
        tracks.start_over(m)  # a fault that is gone is no evidence against the bench of now
        interlocks.start_over(m)
    m.arming_s = m.arming_s + elapsed_s if arming else 0.0
    m.state, m.arming, m.stopping = state, arming, stopping
    return bars


@jit
def _record(m: np.record, s: np.record, f: np.record, command: np.record, tick: np.record) -> None:
    """Copy what was read and decided into the tick."""
    tick.t_ns = f.t_ns
    tick.encoder_gray = f.encoder_gray
    tick.encoder_count = m.encoder_count
    tick.angle_rad = m.angle_rad
    tick.speed_rad_s = m.speed_rad_s
    tick.i_a_A, tick.i_b_A, tick.i_c_A = f.i_A[0], f.i_A[1], f.i_A[2]
    tick.u_a_V, tick.u_b_V, tick.u_c_V = f.u_V[0], f.u_V[1], f.u_V[2]
    i_A = command.i_A
    tick.i_cmd_a_A, tick.i_cmd_b_A, tick.i_cmd_c_A = i_A[0], i_A[1], i_A[2]
    tick.u_bus_V = f.u_bus_V
    tick.torque_Nm = f.torque_Nm
    tick.temperature_C = f.temperature_C
    tick.torque_set_Nm = m.torque_set_Nm
    tick.speed_set_rad_s = s.speed_rad_s
    tick.state = m.state
    tick.first_trip = m.first_trip
    tick.plan_point = s.plan_point
    tick.i_age_ns = _i32(f.t_ns - f.t_inverter_ns)
    tick.sample_age_ns = _i32(f.now_ns - f.t_ns)
    tick.inverter_status = f.inverter_status
    tick.bridge_status = f.bridge_status
    tick.link_errors = f.link_errors
    tick.brake_set = s.brake
    tick.brake_temperature_C = s.brake_temperature_C
    tick.drive_set_rad_s = s.drive_rad_s
    tick.setpoint_seq = s.seq


@jit
def step(
    parameters: np.ndarray,
    back_emf: np.ndarray,
    cogging_Nm: np.ndarray,
    learned_Nm: np.ndarray,
    memory: np.ndarray,
    feedback: np.ndarray,
    setpoint: np.ndarray,
    command: np.ndarray,
    tick: np.ndarray,
) -> None:
    """Run one tick. All but the tables are one-element arrays of the dtypes in `control.types`.

    back_emf: (counts, 3), V s/rad; cogging_Nm: (counts,), Nm, at angles 2 pi n / counts;
    learned_Nm: (COEFFICIENTS_MAX,), Nm.
    """
    p, m, f, s = parameters[0], memory[0], feedback[0], setpoint[0]
    c, t = command[0], tick[0]
    flags = _FLAG.SIMULATED if p.simulated else 0
    flags |= _FLAG.NEW_ENCODER if f.t_ns != m.t_bridge_ns else 0
    flags |= _FLAG.NEW_INVERTER if f.t_inverter_ns != m.t_inverter_ns else 0
    m.t_bridge_ns = f.t_ns
    m.t_inverter_ns = f.t_inverter_ns
    count = observer.decode(f.encoder_gray, p)
    if count >= 0:
        m.encoder_count = count
    if flags & _FLAG.NEW_ENCODER or not m.tracking:  # a sample that is seen again counts once
        observer.observe(p, m, f.t_ns, count)
    elapsed_s = p.period_s
    if m.started:
        elapsed_s = min(max((f.now_ns - m.now_ns) * 1e-9, 0.0), ELAPSED_MAX_S)
    m.now_ns = f.now_ns
    interlocks.update_i2t(p, m, f, elapsed_s)
    interlocks.count_link_errors(m, f.link_errors, elapsed_s)
    supervisor_late = (f.now_ns - s.heartbeat_ns) * 1e-9 > p.supervisor_timeout_s
    flags |= _FLAG.SUPERVISOR_ABSENT if supervisor_late else 0
    causes = _decide(p, m, s, f, t.missed, flags, supervisor_late, elapsed_s)
    t.trip_bits = causes if m.state == STATE.OFF else m.trip_bits
    flags |= _set_torque(p, m, s, supervisor_late, elapsed_s)
    age_s = (f.now_ns - m.t_ns) * 1e-9
    aged = age_s > POSITION_AGE_MAX_S
    ahead_s = min(age_s, POSITION_AGE_MAX_S) + p.actuation_delay_s
    angle_rad = observer.wrap_angle(m.angle_rad + m.speed_rad_s * ahead_s)
    t.angle_predicted_rad = angle_rad
    c.angle_rad, c.speed_rad_s = angle_rad, m.speed_rad_s
    c.angle_ns = m.t_ns + int(ahead_s * 1e9)
    t.cogging_comp_Nm = 0.0
    c.i_A[0], c.i_A[1], c.i_A[2] = 0.0, 0.0, 0.0
    if m.state == STATE.ENABLED:
        if aged:
            flags |= _FLAG.POSITION_AGED
            m.torque_cut_Nm = max(m.torque_cut_Nm, abs(m.torque_asked_Nm))
        else:
            flags |= _currents(p, m, s, back_emf, cogging_Nm, learned_Nm, angle_rad, c, t)
    remember_command(p, m, s, c.i_A)
    c.enable = 1 if m.state == STATE.ENABLED or m.arming else 0
    c.brake = s.brake
    c.drive_rad_s = s.drive_rad_s
    t["flags"] |= flags  # not t.flags: numpy has an attribute of that name
    m.missed = t.missed
    m.started = 1
    _record(m, s, f, c, t)
