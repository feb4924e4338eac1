"""Value and limit of each cause of a trip, from the ticks up to it.

Limits are those of the kernel, its `PARAMETERS`. Values are read from the ticks, which do not hold
all of the kernel's memory. For a condition on a status word the value is how long it has held, in
s, and the limit is how long it may.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from motord.config.timing import TORQUE_SHARE
from motord.schema import BridgeStatus, InverterStatus, State, Trip

ValuesAndLimits = Mapping[str, Mapping[str, float]]
"""By quantity and unit: `value` and `limit`."""
PHASES = "abc"
DERATING = "part of i2t_time_s that the warm winding takes away"
JUMP_TICKS = 10
"""Ticks before the trip in which the jump of an implausible encoder is looked for."""


@dataclass(frozen=True)
class TripWindow:
    """The ticks up to the trip, shape (n,), the kernel's parameters, and the torque expected then.

    `expected_Nm`: what the torque sensor should show, after its high-pass; `channels`: the slow
    channels that trip the bench; `i2t_derating`: the part of i2t_time_s that a warm winding takes;
    `induced_offset_A`: what is put on the phases' currents on purpose.
    """

    ticks: np.ndarray
    expected_Nm: float
    parameters: np.record
    channels: ValuesAndLimits = field(default_factory=dict)
    i2t_derating: float = 0.0
    induced_offset_A: Sequence[float] = (0.0, 0.0, 0.0)

    @property
    def last(self) -> Any:
        """The tick of the trip."""
        return self.ticks[-1]

    def held_s(self, holds: np.ndarray) -> float:
        """Return for how long `holds`, shape (n,), has been true up to the last tick, included."""
        ended = np.flatnonzero(~holds)
        first = ended[-1] + 1 if len(ended) else 0
        if first == len(holds):
            return 0.0
        numbers = self.ticks["tick"][first:].astype(np.int64)
        return float(numbers[-1] - numbers[0] + 1) / self.rate_Hz

    @property
    def rate_Hz(self) -> int:
        """Ticks per second."""
        return round(1.0 / float(self.parameters.period_s))

    def currents_A(self) -> np.ndarray:
        """Return the phase currents of the last tick, shape (3,)."""
        return np.array([float(self.last[f"i_{phase}_A"]) for phase in PHASES])


Quantity = Callable[[TripWindow], float]


def _field(name: str) -> Quantity:
    return lambda window: float(window.last[name])


def _magnitude(name: str) -> Quantity:
    return lambda window: abs(float(window.last[name]))


def _bits_set(word: str, bits: int) -> Quantity:
    return lambda window: window.held_s(window.ticks[word] & bits != 0)


def _bits_clear(word: str, bits: int) -> Quantity:
    return lambda window: window.held_s(window.ticks[word] & bits == 0)


def _largest_A(window: TripWindow) -> float:
    return float(np.abs(window.currents_A()).max())


def _jump_rad(window: TripWindow) -> float:
    counts = int(window.parameters.counts)
    steps = np.diff(window.ticks["encoder_count"][-JUMP_TICKS:].astype(np.int64))
    steps = np.remainder(steps + counts // 2, counts) - counts // 2
    return float(np.abs(steps).max(initial=0)) * 2 * np.pi / counts


def _faulty_s(window: TripWindow) -> float:
    status, state = window.ticks["inverter_status"], window.ticks["state"]
    unpowered = (status & InverterStatus.READY == 0) & (state == State.ENABLED)
    holds = (status & InverterStatus.FAULT != 0) | unpowered
    holds[-1] = True  # the state is that after the trip
    return window.held_s(holds)


def _silent_s(window: TripWindow) -> float:
    seq = window.ticks["setpoint_seq"]
    return window.held_s(seq == seq[-1])


def _errors(window: TripWindow) -> float:
    counts = window.ticks["link_errors"][-window.rate_Hz :]
    return float(int(counts[-1]) - int(counts[0]))


def _bus_limit_V(window: TripWindow) -> float:
    low, high = float(window.parameters.bus_V_min), float(window.parameters.bus_V_max)
    return low if float(window.last["u_bus_V"]) < low else high


def _arming_s(window: TripWindow) -> float:
    ready = window.ticks["state"] == State.READY
    ready[-1] = True  # the state is that after the trip
    return window.held_s(ready)


def _not_finite(window: TripWindow) -> float:
    values = (float(window.last["torque_Nm"]), *window.currents_A())
    return float(sum(not np.isfinite(value) for value in values))


def _current_error_A(window: TripWindow) -> float:
    """Return the distance of the currents from the nearest command that can have been in force."""
    now_A = window.currents_A()
    begun_ns = window.ticks["t_ns"][:-1] + window.ticks["sample_age_ns"][:-1]
    measured_ns = int(window.last["t_ns"]) - int(window.last["i_age_ns"])
    settled_ns = measured_ns - int(window.parameters.settling_ns)
    sent, settled = np.searchsorted(begun_ns, [measured_ns, settled_ns], side="right")
    before = window.ticks[max(min(settled - 1, sent - 2), 0) : sent]
    if not len(before):
        return float(np.abs(now_A).max())
    commands_A = np.stack([before[f"i_cmd_{phase}_A"].astype(float) for phase in PHASES], axis=1)
    error_A = now_A - commands_A
    if window.parameters.star:
        error_A -= error_A.mean(axis=1, keepdims=True)
    return float(np.abs(error_A).max(axis=1).min())


def _torque_limit_Nm(window: TripWindow) -> float:
    before_Nm = abs(float(window.ticks["torque_set_Nm"][-2:][0]))
    induced_Nm = float(window.parameters.torque_per_A) * sum(map(abs, window.induced_offset_A))
    return float(window.parameters.torque_error_Nm) + TORQUE_SHARE * before_Nm + induced_Nm


_LINE_OPEN = "enable line open, for s"
_BRIDGE_FAULT = BridgeStatus.FAULT | BridgeStatus.ENCODER_INVALID
_QUANTITIES: dict[Trip, tuple[str, Quantity, str | Quantity]] = {
    Trip.OVER_CURRENT: ("largest phase current, A", _largest_A, "trip_current_A"),
    Trip.OVER_SPEED: ("speed, rad/s", _magnitude("speed_rad_s"), "trip_speed_rad_s"),
    Trip.OVER_TORQUE: ("torque, Nm", _magnitude("torque_Nm"), "trip_torque_Nm"),
    Trip.I2T: (
        "largest phase current now, for the continuous one, A", _largest_A, "i2t_current_A"
    ),
    Trip.ENCODER_STALE: (
        "age of the encoder's sample, s",
        lambda window: 1e-9 * int(window.last["sample_age_ns"]),
        "bridge_stale_s",
    ),
    Trip.ENCODER_IMPLAUSIBLE: (
        "largest step of the encoder within ten ticks, rad", _jump_rad, "encoder_jump_rad"
    ),
    Trip.TORQUE_STALE: (
        "torque not valid, for s", _bits_set("bridge_status", BridgeStatus.TORQUE_INVALID), ""
    ),
    Trip.INVERTER_STALE: (
        "age of the inverter's feedback, s",
        lambda window: 1e-9 * (int(window.last["sample_age_ns"]) + int(window.last["i_age_ns"])),
        "inverter_stale_s",
    ),
    Trip.INVERTER_FAULT: ("fault or no power, for s", _faulty_s, ""),
    Trip.BUS_OFF: (
        "off the bus, for s", _bits_set("inverter_status", InverterStatus.BUS_OFF), ""
    ),
    Trip.LOOP_OVERRUN: (
        "periods missed in a row",
        lambda window: float(np.diff(window.ticks["missed"][-2:].astype(np.int64)).sum()),
        "overrun_ticks",
    ),
    Trip.SUPERVISOR_STALE: ("since the last set-point, s", _silent_s, "supervisor_timeout_s"),
    Trip.TEMPERATURE: (
        "inverter temperature, degC", _field("temperature_C"), "trip_temperature_C"
    ),
    Trip.LINK_ERRORS: ("frames lost or corrupt within a second", _errors, "link_errors_per_s"),
    Trip.BUS_VOLTAGE: ("bus voltage, V", _field("u_bus_V"), _bus_limit_V),
    Trip.ENABLE_TIMEOUT: (
        "READY without power, as far as looked back, s", _arming_s, "enable_timeout_s"
    ),
    Trip.BRIDGE_FAULT: (
        "fault of the bridge or an encoder not to be trusted, for s",
        _bits_set("bridge_status", _BRIDGE_FAULT),
        "",
    ),
    Trip.FEEDBACK_INVALID: ("values that are not numbers", _not_finite, ""),
    Trip.CURRENT_IMPLAUSIBLE: (
        "largest distance of a current from its command, A", _current_error_A, "current_error_A"
    ),
    Trip.TORQUE_IMPLAUSIBLE: (
        "distance of the torque from what the sensor should say, Nm",
        lambda window: abs(float(window.last["torque_Nm"]) - window.expected_Nm),
        _torque_limit_Nm,
    ),
    Trip.BRAKE_TEMPERATURE: (
        "brake temperature, degC", _field("brake_temperature_C"), "brake_trip_C"
    ),
    Trip.ENABLE_LINE: (_LINE_OPEN, _bits_clear("bridge_status", BridgeStatus.ENABLE_LINE), ""),
    Trip.CHANNEL: (
        "channels that trip", lambda window: float(len(window.channels)), lambda window: 0.0
    ),
}  # fmt: skip
"""Quantity, its value, and its limit: a function, a field of PARAMETERS, or "" for the debounce
time of the condition."""


_OPENED: dict[str, Quantity] = {
    "no heartbeat acknowledged by the bridge board, for s": _bits_set(
        "bridge_status", BridgeStatus.HEARTBEAT_LOST
    ),
    "bridge board barred by a host of another protocol, for s": _bits_set(
        "bridge_status", BridgeStatus.BARRED
    ),
    "another bridge board answers, for s": _bits_set("bridge_status", BridgeStatus.OTHER_BOARD),
}
"""Why the line is not confirmed closed; ENABLE_LINE has those that hold among its values."""

_UNPOWERED: dict[str, Quantity] = {
    _LINE_OPEN: _bits_clear("bridge_status", BridgeStatus.ENABLE_LINE),
    **_OPENED,
    "inverter not ready, for s": _bits_clear("inverter_status", InverterStatus.READY),
}
"""What keeps a bench from power; ENABLE_TIMEOUT has those that hold among its values."""


def _limit(trip: Trip, limit: str | Quantity, window: TripWindow) -> float:
    if not isinstance(limit, str):
        return limit(window)
    if limit:
        return float(window.parameters[limit])
    return int(window.parameters.lasts_ns[int(trip).bit_length() - 1]) / 1e9


def trip_values(bits: int, window: TripWindow) -> ValuesAndLimits:
    """Return value and limit for each cause in `bits`, by the quantity's name and unit."""
    values: dict[str, Mapping[str, float]] = {
        quantity: {"value": value(window), "limit": _limit(trip, limit, window)}
        for trip, (quantity, value, limit) in _QUANTITIES.items()
        if bits & trip
    }
    for trip, reasons in ((Trip.ENABLE_LINE, _OPENED), (Trip.ENABLE_TIMEOUT, _UNPOWERED)):
        for quantity, held in reasons.items() if bits & trip else ():
            if held_s := held(window):
                limit_s = _limit(trip, _QUANTITIES[trip][2], window)
                values.setdefault(quantity, {"value": held_s, "limit": limit_s})
    if bits & Trip.I2T and window.i2t_derating > 0.0:
        values[DERATING] = {"value": window.i2t_derating, "limit": 1.0}
    return {**values, **window.channels} if bits & Trip.CHANNEL else values
