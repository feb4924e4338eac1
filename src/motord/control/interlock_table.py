"""Every interlock, once: cause, meaning, limit, and how long its condition may last.

From this table come the kernel's debounce times, the words of events and the documentation.
"""

from dataclasses import dataclass
from typing import Literal

from motord.schema import Trip

Counted = Literal["ticks", "samples of the bridge", "samples of the inverter"]


@dataclass(frozen=True)
class Interlock:
    """A cause of a trip.

    `limit`: the keys of the bench file that set it. The condition may last `lasts` ticks or samples
    without a trip, or for the time that the key `lasts_s` sets.
    """

    trip: Trip
    meaning: str
    limit: str
    lasts: int = 0
    counted: Counted = "ticks"
    lasts_s: str = ""


_BRIDGE: Counted = "samples of the bridge"
_INVERTER: Counted = "samples of the inverter"

INTERLOCKS = (
    Interlock(
        Trip.OVER_CURRENT, "a phase current was above limits.trip_current_A",
        "limits.trip_current_A", 1, _INVERTER,
    ),
    Interlock(
        Trip.OVER_SPEED, "the rotor turned faster than limits.trip_speed_rad_s",
        "limits.trip_speed_rad_s", 2,
    ),
    Interlock(
        Trip.OVER_TORQUE, "the measured torque was above limits.trip_torque_Nm",
        "limits.trip_torque_Nm", 5, _BRIDGE,
    ),
    Interlock(
        Trip.I2T,
        "the currents heated the motor more than limits.i2t_current_A and i2t_time_s allow",
        "limits.i2t_current_A, limits.i2t_time_s",
    ),
    Interlock(
        Trip.ENCODER_STALE, "no new encoder sample came within bridge.stale_after_s",
        "bridge.stale_after_s",
    ),
    Interlock(
        Trip.ENCODER_IMPLAUSIBLE,
        "the encoder jumped further than the speed can explain, or one of its tracks is stuck",
        "limits.encoder_jump_rad", 2, _BRIDGE,
    ),
    Interlock(Trip.TORQUE_STALE, "the torque sample is not valid", "", 5, _BRIDGE),
    Interlock(
        Trip.INVERTER_STALE,
        "no feedback came from the inverter within inverter.stale_after_s",
        "inverter.stale_after_s",
    ),
    Interlock(
        Trip.INVERTER_FAULT, "the inverter reports a fault, or its power stage went off", "", 2
    ),
    Interlock(Trip.BUS_OFF, "the CAN controller is off the bus", ""),
    Interlock(
        Trip.LOOP_OVERRUN, "the loop missed loop.overrun_ticks periods in a row",
        "loop.overrun_ticks",
    ),
    Interlock(
        Trip.SUPERVISOR_STALE,
        "the supervisor gave no sign of life within loop.supervisor_timeout_s",
        "loop.supervisor_timeout_s",
    ),
    Interlock(
        Trip.TEMPERATURE, "the inverter is hotter than limits.trip_temperature_C",
        "limits.trip_temperature_C", 20, _INVERTER,
    ),
    Interlock(
        Trip.LINK_ERRORS, "more frames were lost or corrupt than limits.link_errors_per_s",
        "limits.link_errors_per_s",
    ),
    Interlock(
        Trip.BUS_VOLTAGE, "the DC bus voltage is outside limits.bus_V_min to bus_V_max",
        "limits.bus_V_min, limits.bus_V_max", 20, _INVERTER,
    ),
    Interlock(
        Trip.ENABLE_TIMEOUT,
        "the inverter was not ready within loop.enable_timeout_s of being enabled",
        "loop.enable_timeout_s",
    ),
    Interlock(
        Trip.BRIDGE_FAULT, "the bridge reports a fault or an encoder that cannot be trusted", ""
    ),
    Interlock(Trip.FEEDBACK_INVALID, "a feedback value is not a number", ""),
    Interlock(
        Trip.CURRENT_IMPLAUSIBLE,
        "a phase current was further than limits.current_error_A from its command",
        "limits.current_error_A", 0, _INVERTER, "limits.current_error_s",
    ),
    Interlock(
        Trip.TORQUE_IMPLAUSIBLE,
        "the measured torque was further than limits.torque_error_Nm from the set-point",
        "limits.torque_error_Nm", 0, _BRIDGE, "limits.torque_error_s",
    ),
    Interlock(
        Trip.BRAKE_TEMPERATURE,
        "the brake's disc is more than 10 K hotter than brake.temperature_max_C",
        "brake.temperature_max_C", 20,
    ),
)  # fmt: skip
"""In the order of their bits: the first of several causes of one tick is the earliest here."""
