"""Trips, flags and requests in words, for events, state and refusals."""

from motord.schema import Flag, Trip

TRIP_MEANING: dict[Trip, str] = {
    Trip.OVER_CURRENT: "a phase current was above limits.trip_current_A",
    Trip.OVER_SPEED: "the rotor turned faster than limits.trip_speed_rad_s",
    Trip.OVER_TORQUE: "the measured torque was above limits.trip_torque_Nm",
    Trip.I2T: "the currents heated the motor more than limits.i2t_current_A and i2t_time_s allow",
    Trip.ENCODER_STALE: "no new encoder sample came within bridge.stale_after_s",
    Trip.ENCODER_IMPLAUSIBLE: "the encoder jumped further than the speed can explain",
    Trip.TORQUE_STALE: "the torque sample is not valid",
    Trip.INVERTER_STALE: "no feedback came from the inverter within inverter.stale_after_s",
    Trip.INVERTER_FAULT: "the inverter reports a fault, or its power stage went off",
    Trip.BUS_OFF: "the CAN controller is off the bus",
    Trip.LOOP_OVERRUN: "the loop missed loop.overrun_ticks periods in a row",
    Trip.SUPERVISOR_STALE: "the supervisor gave no sign of life within loop.supervisor_timeout_s",
    Trip.TEMPERATURE: "the inverter is hotter than limits.trip_temperature_C",
    Trip.LINK_ERRORS: "more frames were lost or corrupt than limits.link_errors_per_s",
    Trip.BUS_VOLTAGE: "the DC bus voltage is outside limits.bus_V_min to bus_V_max",
    Trip.ENABLE_TIMEOUT: "the inverter was not ready within loop.enable_timeout_s of being enabled",
    Trip.BRIDGE_FAULT: "the bridge reports a fault or an encoder that cannot be trusted",
    Trip.FEEDBACK_INVALID: "a feedback value is not a number",
}
"""What each cause of a trip means, with the key of the bench file that sets its limit."""


def trip_names(bits: int) -> list[str]:
    """Return the names of the causes in `bits`, the lowest bit first."""
    return [trip.name for trip in Trip if bits & trip and trip.name]


def trip_words(bits: int) -> str:
    """Return the causes in `bits` in words, in one line."""
    parts = [f"{trip.name} ({TRIP_MEANING[trip]})" for trip in Trip if bits & trip]
    return "; ".join(parts) or "no cause"


def flag_names(bits: int) -> list[str]:
    """Return the names of the flags in `bits`."""
    return [flag.name for flag in Flag if bits & flag and flag.name]
