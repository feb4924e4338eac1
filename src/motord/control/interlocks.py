"""Trip conditions, evaluated every tick in compiled code. Latching is `step`'s and `states`' work.

Each condition has a bit of `schema.Trip`, a limit of the bench file, and the number of ticks or
samples that it must outlast (`control.interlock_table`). What a sensor says is counted by its
samples, not by ticks: a sample that is seen again is no further evidence.
"""

import math

import numpy as np

from motord.control.interlock_table import INTERLOCKS
from motord.control.plausible import current_error, torque_error
from motord.control.states import ENABLED, OFF
from motord.control.tracks import watch_tracks
from motord.jit import jit
from motord.schema import BridgeStatus, Flag, InverterStatus, Trip

TRIPS = tuple(Trip)
_LASTS = {interlock.trip: interlock.lasts for interlock in INTERLOCKS}
_DEBOUNCE = np.array([_LASTS[trip] for trip in TRIPS], dtype=np.int64)

_NEW_BRIDGE = int(Flag.NEW_ENCODER)
_NEW_INVERTER = int(Flag.NEW_INVERTER)
_READY = int(InverterStatus.READY)
_FAULT = int(InverterStatus.FAULT)
_BUS_OFF = int(InverterStatus.BUS_OFF)
_TORQUE_INVALID = int(BridgeStatus.TORQUE_INVALID)
_ENCODER_INVALID = int(BridgeStatus.ENCODER_INVALID)
_BRIDGE_FAULT = int(BridgeStatus.FAULT)

IMPLAUSIBLE_SAMPLES = 3
LINK_MEMORY_S = 1.0


@jit
def _bit(trip_index: int, condition: bool, m: np.record) -> int:
    """Return the bit of a trip whose condition has outlasted its debounce time, or 0."""
    if not condition:
        m.debounce[trip_index] = 0
        return 0
    m.debounce[trip_index] += 1
    return (1 << trip_index) if m.debounce[trip_index] > _DEBOUNCE[trip_index] else 0


@jit
def _sampled(trip_index: int, condition: bool, new: int, m: np.record) -> int:
    """As `_bit`, for a condition of a sample: the count moves with new samples only."""
    if new:
        return _bit(trip_index, condition, m)
    return (1 << trip_index) if m.debounce[trip_index] > _DEBOUNCE[trip_index] else 0


@jit
def _sampled_for(trip_index: int, condition: bool, new: int, lasts: int, m: np.record) -> int:
    """As `_sampled`, with the number of samples that the bench file's time comes to."""
    if new:
        m.debounce[trip_index] = m.debounce[trip_index] + 1 if condition else 0
    return (1 << trip_index) if m.debounce[trip_index] > lasts else 0


@jit
def heat_up(p: np.record, m: np.record, f: np.record) -> None:
    """Advance the I2t accumulators: seconds at sqrt(2) times the continuous current."""
    for phase in range(3):
        ratio = f.i_A[phase] / p.i2t_current_A
        if math.isfinite(ratio):
            heat_s = m.heat_s[phase] + (ratio * ratio - 1.0) * p.period_s
            m.heat_s[phase] = min(max(heat_s, 0.0), 2.0 * p.i2t_time_s)


@jit
def count_link_errors(p: np.record, m: np.record, link_errors: int) -> None:
    """Let the level of link errors decay with a time constant of LINK_MEMORY_S and add new ones."""
    new = link_errors - m.link_errors
    m.link_errors = link_errors
    m.link_level *= 1.0 - min(p.period_s / LINK_MEMORY_S, 1.0)
    if new > 0 and m.started:
        m.link_level += new


@jit
def causes(
    p: np.record,
    m: np.record,
    f: np.record,
    missed: int,
    new: int,
    supervisor_late: bool,
    brake_C: float,
) -> int:
    """Return the trip bits that hold now. Advances the debounce counters in `m`.

    `new`: flags of the tick that say which samples are new (`schema.Flag`).
    """
    inverter_age_s = (f.now_ns - f.t_inverter_ns) * 1e-9
    bridge_age_s = (f.now_ns - f.t_ns) * 1e-9
    largest_A = max(abs(f.i_A[0]), abs(f.i_A[1]), abs(f.i_A[2]))
    finite = math.isfinite(f.i_A[0] + f.i_A[1] + f.i_A[2]) and math.isfinite(f.torque_Nm)
    status = f.inverter_status
    lost_power = m.state == ENABLED and (status & _READY) == 0
    bits = _sampled(0, largest_A > p.trip_current_A, new & _NEW_INVERTER, m)
    bits |= _bit(1, abs(m.speed_rad_s) > p.trip_speed_rad_s, m)
    bits |= _sampled(2, abs(f.torque_Nm) > p.trip_torque_Nm, new & _NEW_BRIDGE, m)
    bits |= _bit(3, max(m.heat_s[0], m.heat_s[1], m.heat_s[2]) > p.i2t_time_s, m)
    bits |= _bit(4, bridge_age_s > p.bridge_stale_s, m)
    stuck = watch_tracks(p, m, f.encoder_gray, f.t_ns)
    bits |= (1 << 5) if stuck or m.implausible >= IMPLAUSIBLE_SAMPLES else 0
    bits |= _sampled(6, (f.bridge_status & _TORQUE_INVALID) != 0, new & _NEW_BRIDGE, m)
    bits |= _bit(7, inverter_age_s > p.inverter_stale_s, m)
    bits |= _bit(8, (status & _FAULT) != 0 or lost_power, m)
    bits |= _bit(9, (status & _BUS_OFF) != 0, m)
    bits |= _bit(10, missed - m.missed >= p.overrun_ticks and m.started, m)
    bits |= _bit(11, supervisor_late and m.torque_set_Nm == 0.0, m)
    bits |= _sampled(12, f.temperature_C > p.trip_temperature_C, new & _NEW_INVERTER, m)
    bits |= _bit(13, m.link_level > p.link_errors_per_s, m)
    bits |= _sampled(14, not (p.bus_V_min <= f.u_bus_V <= p.bus_V_max), new & _NEW_INVERTER, m)
    bits |= _bit(15, m.arming_s > p.enable_timeout_s, m)
    bits |= _bit(16, (f.bridge_status & (_BRIDGE_FAULT | _ENCODER_INVALID)) != 0, m)
    bits |= _bit(17, not finite, m)
    astray = current_error(p, m, f) > p.current_error_A
    bits |= _sampled_for(18, astray, new & _NEW_INVERTER, p.current_error_samples, m)
    astray = torque_error(p, m, f.torque_Nm) > p.torque_error_Nm
    astray = astray and m.state == ENABLED and not m.limited
    bits |= _sampled_for(19, astray, new & _NEW_BRIDGE, p.torque_error_samples, m)
    return bits | _bit(20, brake_C > p.brake_trip_C, m)


@jit
def latch(m: np.record, bits: int) -> None:
    """Add `bits` to the latched causes; the first ones are kept apart. OFF latches nothing."""
    if m.state == OFF or bits == 0:
        return
    if m.first_trip == 0:
        m.first_trip = bits & -bits
    m.trip_bits |= bits
