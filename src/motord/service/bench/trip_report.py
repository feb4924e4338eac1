"""What was measured at a trip, beside the limit that it went beyond: one row for each cause.

Where the condition is a bit of a status word, the value is for how long it has held, in s, and the
limit for how long it may.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from motord.config import Config
from motord.control.interlock_table import INTERLOCK
from motord.control.parameters import BRAKE_MARGIN_K, CURRENT_ERROR, TORQUE_ERROR, settling_ns
from motord.control.plausible import TORQUE_SHARE
from motord.schema import BridgeStatus, InverterStatus, State, Trip

PHASES = "abc"
JUMP_TICKS = 10
"""So far back the account of an implausible encoder looks for the jump."""


@dataclass(frozen=True)
class Seen:
    """The ticks up to the trip (shape (n,), the last is its own) and the torque expected then."""

    ticks: np.ndarray
    expected_Nm: float
    config: Config

    @property
    def last(self) -> np.void:
        """The tick of the trip."""
        last: np.void = self.ticks[-1]
        return last

    def held_s(self, holds: np.ndarray) -> float:
        """Return for how long `holds`, shape (n,), has been true up to the last tick, included."""
        ended = np.flatnonzero(~holds)
        first = ended[-1] + 1 if len(ended) else 0
        if first == len(holds):
            return 0.0
        numbers = self.ticks["tick"][first:].astype(np.int64)
        return float(numbers[-1] - numbers[0] + 1) / self.config.loop.rate_Hz


Number = Callable[[Seen], float]


def _field(name: str) -> Number:
    return lambda seen: float(seen.last[name])


def _size(name: str) -> Number:
    return lambda seen: abs(float(seen.last[name]))


def _largest_A(seen: Seen) -> float:
    return max(abs(float(seen.last[f"i_{phase}_A"])) for phase in PHASES)


def _allowed(trip: Trip) -> Number:
    return lambda seen: INTERLOCK[trip].lasts_s(seen.config)


def _inverter_age_s(seen: Seen) -> float:
    return 1e-9 * (int(seen.last["sample_age_ns"]) + int(seen.last["i_age_ns"]))


def _jump_rad(seen: Seen) -> float:
    counts = seen.config.motor.counts
    steps = np.diff(seen.ticks["encoder_count"][-JUMP_TICKS:].astype(np.int64))
    steps = np.remainder(steps + counts // 2, counts) - counts // 2
    return float(np.abs(steps).max(initial=0)) * 2 * np.pi / counts


def _faulty(seen: Seen) -> float:
    status, state = seen.ticks["inverter_status"], seen.ticks["state"]
    unpowered = (status & InverterStatus.READY == 0) & (state == State.ENABLED)
    holds = (status & InverterStatus.FAULT != 0) | unpowered
    holds[-1] = True  # the state is that after the trip
    return seen.held_s(holds)


def _missed(seen: Seen) -> float:
    return float(np.diff(seen.ticks["missed"][-2:].astype(np.int64)).sum())


def _silent_s(seen: Seen) -> float:
    seq = seen.ticks["setpoint_seq"]
    return seen.held_s(seq == seq[-1])


def _errors(seen: Seen) -> float:
    counts = seen.ticks["link_errors"][-seen.config.loop.rate_Hz :]
    return float(int(counts[-1]) - int(counts[0]))


def _bus_limit_V(seen: Seen) -> float:
    limits = seen.config.limits
    return limits.bus_V_min if float(seen.last["u_bus_V"]) < limits.bus_V_min else limits.bus_V_max


def _arming_s(seen: Seen) -> float:
    ready = seen.ticks["state"] == State.READY
    ready[-1] = True  # the state is that after the trip
    return seen.held_s(ready)


def _not_numbers(seen: Seen) -> float:
    names = ("torque_Nm", *(f"i_{phase}_A" for phase in PHASES))
    return float(sum(not np.isfinite(seen.last[name]) for name in names))


def _astray_A(seen: Seen) -> float:
    """Return how far the currents are from the nearest command that can have been in force."""
    now = np.array([float(seen.last[f"i_{phase}_A"]) for phase in PHASES])
    begun_ns = seen.ticks["t_ns"][:-1] + seen.ticks["sample_age_ns"][:-1]
    measured_ns = int(seen.last["t_ns"]) - int(seen.last["i_age_ns"])
    sent, settled = np.searchsorted(
        begun_ns, [measured_ns, measured_ns - settling_ns(seen.config)], side="right"
    )
    commands = seen.ticks[max(min(settled - 1, sent - 2), 0) : sent]
    if not len(commands):
        return float(np.abs(now).max())
    apart = now - np.stack([commands[f"i_cmd_{phase}_A"].astype(float) for phase in PHASES], axis=1)
    if seen.config.motor.connection == "star":
        apart -= apart.mean(axis=1, keepdims=True)
    return float(np.abs(apart).max(axis=1).min())


def _torque_limit_Nm(seen: Seen) -> float:
    limits, before = seen.config.limits, seen.ticks["torque_set_Nm"][-2:]
    share_Nm = TORQUE_SHARE * abs(float(before[0]))
    return (limits.torque_error_Nm or TORQUE_ERROR * limits.torque_Nm) + share_Nm


_VALUES: dict[Trip, tuple[str, Number, Number]] = {
    Trip.OVER_CURRENT: (
        "largest phase current, A", _largest_A, lambda seen: seen.config.limits.trip_current_A
    ),
    Trip.OVER_SPEED: (
        "speed, rad/s", _size("speed_rad_s"), lambda seen: seen.config.limits.trip_speed_rad_s
    ),
    Trip.OVER_TORQUE: (
        "torque, Nm", _size("torque_Nm"), lambda seen: seen.config.limits.trip_torque_Nm
    ),
    Trip.I2T: (
        "largest phase current now, for the continuous one, A",
        _largest_A,
        lambda seen: seen.config.limits.i2t_current_A,
    ),
    Trip.ENCODER_STALE: (
        "age of the encoder's sample, s",
        lambda seen: 1e-9 * int(seen.last["sample_age_ns"]),
        lambda seen: seen.config.bridge.stale_after_s,
    ),
    Trip.ENCODER_IMPLAUSIBLE: (
        "largest step of the encoder within ten ticks, rad",
        _jump_rad,
        lambda seen: seen.config.limits.encoder_jump_rad,
    ),
    Trip.TORQUE_STALE: (
        "torque not valid, for s",
        lambda seen: seen.held_s(seen.ticks["bridge_status"] & BridgeStatus.TORQUE_INVALID != 0),
        _allowed(Trip.TORQUE_STALE),
    ),
    Trip.INVERTER_STALE: (
        "age of the inverter's feedback, s",
        _inverter_age_s,
        lambda seen: seen.config.inverter.stale_after_s,
    ),
    Trip.INVERTER_FAULT: (
        "fault or no power, for s",
        _faulty,
        _allowed(Trip.INVERTER_FAULT),
    ),
    Trip.BUS_OFF: (
        "off the bus, for s",
        lambda seen: seen.held_s(seen.ticks["inverter_status"] & InverterStatus.BUS_OFF != 0),
        _allowed(Trip.BUS_OFF),
    ),
    Trip.LOOP_OVERRUN: (
        "periods missed in a row", _missed, lambda seen: seen.config.loop.overrun_ticks
    ),
    Trip.SUPERVISOR_STALE: (
        "since the last set-point, s",
        _silent_s,
        lambda seen: seen.config.loop.supervisor_timeout_s,
    ),
    Trip.TEMPERATURE: (
        "inverter temperature, degC",
        _field("temperature_C"),
        lambda seen: seen.config.limits.trip_temperature_C,
    ),
    Trip.LINK_ERRORS: (
        "frames lost or corrupt within a second",
        _errors,
        lambda seen: seen.config.limits.link_errors_per_s,
    ),
    Trip.BUS_VOLTAGE: ("bus voltage, V", _field("u_bus_V"), _bus_limit_V),
    Trip.ENABLE_TIMEOUT: (
        "READY without power, as far as looked back, s",
        _arming_s,
        lambda seen: seen.config.loop.enable_timeout_s,
    ),
    Trip.BRIDGE_FAULT: (
        "fault of the bridge or an encoder not to be trusted, for s",
        lambda seen: seen.held_s(
            seen.ticks["bridge_status"] & (BridgeStatus.FAULT | BridgeStatus.ENCODER_INVALID) != 0
        ),
        _allowed(Trip.BRIDGE_FAULT),
    ),
    Trip.FEEDBACK_INVALID: (
        "values that are not numbers", _not_numbers, _allowed(Trip.FEEDBACK_INVALID)
    ),
    Trip.CURRENT_IMPLAUSIBLE: (
        "largest distance of a current from its command, A",
        _astray_A,
        lambda seen: seen.config.limits.current_error_A
        or CURRENT_ERROR * seen.config.limits.current_A,
    ),
    Trip.TORQUE_IMPLAUSIBLE: (
        "distance of the torque from what the sensor should say, Nm",
        lambda seen: abs(float(seen.last["torque_Nm"]) - seen.expected_Nm),
        _torque_limit_Nm,
    ),
    Trip.BRAKE_TEMPERATURE: (
        "brake temperature, degC",
        _field("brake_temperature_C"),
        lambda seen: seen.config.brake.temperature_max_C + BRAKE_MARGIN_K,
    ),
    Trip.ENABLE_LINE: (
        "enable line open, for s",
        lambda seen: seen.held_s(seen.ticks["bridge_status"] & BridgeStatus.ENABLE_LINE == 0),
        _allowed(Trip.ENABLE_LINE),
    ),
}  # fmt: skip


def trip_values(bits: int, seen: Seen) -> dict[str, dict[str, float]]:
    """Return value and limit for each cause in `bits`, by what the value is."""
    return {
        what: {"value": value(seen), "limit": float(limit(seen))}
        for trip, (what, value, limit) in _VALUES.items()
        if bits & trip
    }
