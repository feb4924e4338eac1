"""Trip conditions, evaluated every tick in compiled code. Latching is `step`'s and `states`' work.

Each condition has a bit of `schema.Trip` and a row in `control.interlock_table`, which says what is
evidence of it and for how long it may hold: a sample that is seen again is no further evidence.
Speed is the observer's estimate, the one that is recorded.
"""

import math

import numpy as np

from motord.control.interlock_table import INTERLOCKS, EvidenceSource, trips_from
from motord.control.plausible import compare_currents, torque_error
from motord.control.states import STATE
from motord.control.tracks import watch_tracks
from motord.jit import constants, jit
from motord.schema import BridgeStatus, Flag, InverterStatus, Trip

_TRIP, _FLAG = constants(Trip), constants(Flag)
_BRIDGE, _INVERTER = constants(BridgeStatus), constants(InverterStatus)
_COUNT = len(INTERLOCKS)
_FROM_BRIDGE = trips_from(EvidenceSource.BRIDGE)
_FROM_INVERTER = trips_from(EvidenceSource.INVERTER)
_OVER_CURRENT, _CURRENTS = _TRIP.OVER_CURRENT, _TRIP.CURRENT_IMPLAUSIBLE
_COUNTED = tuple(row.bit for row in INTERLOCKS if row.counted)
_COUNTED_BITS = sum(1 << bit for bit in _COUNTED)
_BRIDGE_FAULT = _BRIDGE.FAULT | _BRIDGE.ENCODER_INVALID

IMPLAUSIBLE_SAMPLES = 3
LINK_MEMORY_S = 1.0
DOUBT_SHARE = 4
"""While it is in doubt whether a condition holds, one part in so many of the time counts down: an
error that is hidden in two of three readings is found, and none is remembered for ever."""


@jit
def update_i2t(p: np.record, m: np.record, f: np.record, elapsed_s: float) -> None:
    """Advance the I2t accumulators: seconds at sqrt(2) times the continuous current.

    A current above trip_current_A counts as that until OVER_CURRENT has found it: a single reading
    may be disturbed, and of any size.
    """
    most_A = math.inf if m.causes & _OVER_CURRENT else p.trip_current_A
    for phase in range(3):
        i_A = abs(f.i_A[phase])
        if math.isfinite(i_A):
            ratio = min(i_A, most_A) / p.i2t_current_A
            heat_s = m.heat_s[phase] + (ratio * ratio - 1.0) * elapsed_s
            m.heat_s[phase] = min(max(heat_s, 0.0), 2.0 * p.i2t_time_s)


@jit
def allowed_heat_s(p: np.record, derating: float) -> float:
    """Return the heat at which I2t trips, never more than i2t_time_s, whatever `derating` is."""
    left = 1.0 - min(derating, 1.0) if derating > 0.0 else 1.0
    return float(p.i2t_time_s * left)


@jit
def count_link_errors(m: np.record, link_errors: int, elapsed_s: float) -> None:
    """Let the level of link errors decay with a time constant of LINK_MEMORY_S and add new ones."""
    new = link_errors - m.link_errors
    m.link_errors = link_errors
    m.recent_link_errors *= 1.0 - min(elapsed_s / LINK_MEMORY_S, 1.0)
    if new > 0 and m.started:
        m.recent_link_errors += new


@jit
def conditions(
    p: np.record,
    m: np.record,
    f: np.record,
    missed: int,
    supervisor_late: bool,
    brake_C: float,
    channels_beyond: int,
    i2t_derating: float,
) -> int:
    """Return the bits of the conditions that are true of this tick, for however short a time.

    A sample may be newer than the tick, by as much as the loop was kept waiting after it woke; one
    from further in the future than a stale one is old has no age that could be trusted.
    """
    inverter_age_s = (f.now_ns - f.t_inverter_ns) * 1e-9
    bridge_age_s = (f.now_ns - f.t_ns) * 1e-9
    largest_A = max(abs(f.i_A[0]), abs(f.i_A[1]), abs(f.i_A[2]))
    finite = math.isfinite(f.i_A[0] + f.i_A[1] + f.i_A[2]) and math.isfinite(f.torque_Nm)
    enabled = m.state == STATE.ENABLED
    status = f.inverter_status
    lost_power = enabled and (status & _INVERTER.READY) == 0
    line_open = enabled and (f.bridge_status & _BRIDGE.ENABLE_LINE) == 0
    stuck = watch_tracks(p, m, f.encoder_gray, f.t_ns)
    lost = m.implausible >= IMPLAUSIBLE_SAMPLES or not m.tracking
    fits, beyond = compare_currents(p, m, f, m.counting & _CURRENTS != 0)
    m.not_compared = 0 if fits or beyond else _CURRENTS
    m.in_doubt = _CURRENTS if fits and beyond else 0
    missed_now = max(missed - m.missed, 0) if m.started else 0
    torque_astray = torque_error(p, m, f.torque_Nm, missed_now) > p.torque_error_Nm
    bits = _OVER_CURRENT if largest_A > p.trip_current_A else 0
    bits |= _TRIP.OVER_SPEED if abs(m.speed_rad_s) > p.trip_speed_rad_s else 0
    bits |= _TRIP.OVER_TORQUE if abs(f.torque_Nm) > p.trip_torque_Nm else 0
    hottest_s = max(m.heat_s[0], m.heat_s[1], m.heat_s[2])
    bits |= _TRIP.I2T if hottest_s > allowed_heat_s(p, i2t_derating) else 0
    bits |= _TRIP.ENCODER_STALE if abs(bridge_age_s) > p.bridge_stale_s else 0
    bits |= _TRIP.ENCODER_IMPLAUSIBLE if stuck or lost else 0
    bits |= _TRIP.TORQUE_STALE if f.bridge_status & _BRIDGE.TORQUE_INVALID else 0
    bits |= _TRIP.INVERTER_STALE if abs(inverter_age_s) > p.inverter_stale_s else 0
    bits |= _TRIP.INVERTER_FAULT if status & _INVERTER.FAULT or lost_power else 0
    bits |= _TRIP.BUS_OFF if status & _INVERTER.BUS_OFF else 0
    bits |= _TRIP.LOOP_OVERRUN if m.started and missed_now >= p.overrun_ticks else 0
    bits |= _TRIP.SUPERVISOR_STALE if supervisor_late and m.torque_set_Nm == 0.0 else 0
    bits |= _TRIP.TEMPERATURE if f.temperature_C > p.trip_temperature_C else 0
    bits |= _TRIP.LINK_ERRORS if m.recent_link_errors > p.link_errors_per_s else 0
    bits |= _TRIP.BUS_VOLTAGE if not p.bus_V_min <= f.u_bus_V <= p.bus_V_max else 0
    bits |= _TRIP.ENABLE_TIMEOUT if m.arming_s > p.enable_timeout_s else 0
    bits |= _TRIP.BRIDGE_FAULT if f.bridge_status & _BRIDGE_FAULT else 0
    bits |= _TRIP.FEEDBACK_INVALID if not finite else 0
    bits |= _CURRENTS if beyond and not fits else 0
    bits |= _TRIP.TORQUE_IMPLAUSIBLE if torque_astray and enabled else 0
    bits |= _TRIP.BRAKE_TEMPERATURE if brake_C > p.brake_trip_C else 0
    bits |= _TRIP.ENABLE_LINE if line_open else 0
    return bits | (_TRIP.CHANNEL if channels_beyond else 0)


@jit
def debounced(p: np.record, m: np.record, bits: int, new: int, now_ns: int) -> int:
    """Return those of the conditions `bits` that have held for longer than they may.

    A condition counts from the first evidence of it in a row, or up and down. Where there is no
    evidence (`new`: flags of the tick that say which samples are new; `m.not_compared`: conditions
    of which they say nothing) everything stays as it was.
    """
    no_evidence = m.not_compared
    no_evidence |= 0 if new & _FLAG.NEW_ENCODER else _FROM_BRIDGE
    no_evidence |= 0 if new & _FLAG.NEW_INVERTER else _FROM_INVERTER
    seen = bits & ~no_evidence
    begun = seen & ~(m.conditions_held | _COUNTED_BITS)
    causes = m.causes & no_evidence
    for index in _COUNTED:
        if not no_evidence >> index & 1:
            _count(p, m, index, seen >> index & 1 != 0, now_ns)
    if seen:
        for index in range(_COUNT):
            if seen >> index & 1:
                if begun >> index & 1:
                    m.since_ns[index] = now_ns
                if now_ns - m.since_ns[index] >= p.lasts_ns[index]:
                    causes |= 1 << index
    m.conditions_held = seen | (m.conditions_held & no_evidence)
    m.causes = causes
    return int(causes)


@jit
def _count(p: np.record, m: np.record, index: int, seen: bool, now_ns: int) -> None:
    """Count the time since the evidence before this one for or against a condition.

    The count is what has passed since `since_ns`, from 0 to the time that the condition may last
    and that since the evidence before. The time after evidence of it counts up, other time down,
    while it is in doubt one part of DOUBT_SHARE. What is between evidence of it and of the opposite
    counts for neither: it may have begun or ended at any time.
    """
    passed_ns = now_ns - m.evidence_ns[index]
    doubt = m.in_doubt >> index & 1 != 0
    held = m.conditions_held >> index & 1 != 0
    since_ns = m.since_ns[index]
    if not held or not (seen or doubt):
        since_ns += passed_ns
    if not held and not seen:
        since_ns += passed_ns // DOUBT_SHARE if doubt else passed_ns
    m.since_ns[index] = min(max(since_ns, now_ns - passed_ns - p.lasts_ns[index]), now_ns)
    m.evidence_ns[index] = now_ns
    counts, bit = seen or since_ns < now_ns, 1 << index
    m.counting = int(m.counting) & ~bit | (bit if counts else 0)


@jit
def start_over(m: np.record) -> None:
    """Count anew what the newest evidence does not show."""
    for index in _COUNTED:
        if not m.conditions_held >> index & 1:
            m.since_ns[index] = m.evidence_ns[index]
            m.counting = int(m.counting) & ~(1 << index)


@jit
def latch(m: np.record, bits: int) -> None:
    """Add `bits` to the latched causes; the first ones are kept apart. OFF latches nothing."""
    if m.state == STATE.OFF or bits == 0:
        return
    if m.first_trip == 0:
        m.first_trip = bits & -bits
    m.trip_bits |= bits
