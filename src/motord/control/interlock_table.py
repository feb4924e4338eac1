"""Every interlock, once: cause, meaning, limit, source of its evidence, and its debounce time.

From this table come the kernel's bits and debounce times, the texts of events, the limits in a
trip report and docs/faults.md; `schema.Trip` has the numbers of the bits. Times are in seconds, so
that they are the same at every loop and sample rate: a condition trips with the first evidence
that it has held for `lasts_s`. Evidence is a new sample of its source; between two samples a
condition is neither confirmed nor refuted, and a source that falls silent has an interlock of its
own. So a cause is found within `lasts_s` and two intervals between samples of its source, whatever
these are, or the source is stale, from when the first evidence of it arrives: of the currents this
is `inverter.feedback_age_s` after they were measured, and a command's have settled by then. A
condition that is interrupted starts over, or is counted up and down: it trips where it holds for
more than half of the time, too. Which are counted, and what currents count that fit another command
than their own: docs/decisions/0023.
"""

from dataclasses import dataclass
from enum import IntEnum

from motord.config import Config
from motord.schema import Trip


class EvidenceSource(IntEnum):
    """Where the evidence of a condition comes from."""

    LOOP = 0
    """Every tick is evidence."""
    BRIDGE = 1
    """A new sample of encoder and torque sensor."""
    INVERTER = 2
    """New feedback of the inverter."""


@dataclass(frozen=True)
class Interlock:
    """A cause of a trip.

    limit: the keys of the bench file that set it. lasts: for how long the condition may hold
    without a trip, in s, or the key of the bench file that says so. counted: this time is counted
    up while it holds and down while it does not, for an error that swings; else it starts over.
    """

    trip: Trip
    meaning: str
    limit: str
    source: EvidenceSource = EvidenceSource.LOOP
    lasts: float | str = 0.0
    counted: bool = False

    @property
    def bit(self) -> int:
        """The number of its bit in `trip_bits`."""
        return self.trip.value.bit_length() - 1

    def lasts_s(self, config: Config) -> float:
        """Return for how long the condition may hold, in s."""
        if isinstance(self.lasts, float):
            return self.lasts
        section, _, key = self.lasts.partition(".")
        return float(getattr(getattr(config, section), key))


INTERLOCKS = (
    Interlock(
        Trip.OVER_CURRENT, "a phase current was above limits.trip_current_A",
        "limits.trip_current_A", EvidenceSource.INVERTER, 0.001,
    ),
    Interlock(
        Trip.OVER_SPEED, "the rotor turned faster than limits.trip_speed_rad_s",
        "limits.trip_speed_rad_s", EvidenceSource.BRIDGE, 0.002,
    ),
    Interlock(
        Trip.OVER_TORQUE, "the measured torque was above limits.trip_torque_Nm",
        "limits.trip_torque_Nm", EvidenceSource.BRIDGE, 0.005,
    ),
    Interlock(
        Trip.I2T,
        "the currents heated the motor more than limits.i2t_current_A and i2t_time_s allow, or "
        "than the warm winding leaves of it",
        "limits.i2t_current_A, limits.i2t_time_s, limits.i2t_derating_from_C",
    ),
    Interlock(
        Trip.ENCODER_STALE, "no new encoder sample came within bridge.stale_after_s",
        "bridge.stale_after_s",
    ),
    Interlock(
        Trip.ENCODER_IMPLAUSIBLE,
        "three encoder samples jumped further than the speed can explain or gave no position, "
        "without two good ones in a row between them, or an encoder track is stuck",
        "limits.encoder_jump_rad",
    ),
    Interlock(
        Trip.TORQUE_STALE, "the torque sample is not valid", "", EvidenceSource.BRIDGE, 0.005
    ),
    Interlock(
        Trip.INVERTER_STALE,
        "no feedback came from the inverter within inverter.stale_after_s, or one message without "
        "currents not within inverter.can.slow_stale_after_s",
        "inverter.stale_after_s",
    ),
    Interlock(
        Trip.INVERTER_FAULT, "the inverter reports a fault, or its power stage went off", "",
        EvidenceSource.LOOP, 0.002,
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
        "limits.trip_temperature_C", EvidenceSource.INVERTER, 0.02,
    ),
    Interlock(
        Trip.LINK_ERRORS, "more frames were lost or corrupt than limits.link_errors_per_s",
        "limits.link_errors_per_s",
    ),
    Interlock(
        Trip.BUS_VOLTAGE, "the DC bus voltage is outside limits.bus_V_min to bus_V_max",
        "limits.bus_V_min, limits.bus_V_max", EvidenceSource.INVERTER, 0.02,
    ),
    Interlock(
        Trip.ENABLE_TIMEOUT,
        "inverter and enable line were not ready within loop.enable_timeout_s of being enabled",
        "loop.enable_timeout_s",
    ),
    Interlock(
        Trip.BRIDGE_FAULT, "the bridge reports a fault or an encoder that cannot be trusted", ""
    ),
    Interlock(Trip.FEEDBACK_INVALID, "a feedback value is not a number", ""),
    Interlock(
        Trip.CURRENT_IMPLAUSIBLE,
        "a phase current was further than limits.current_error_A from its command",
        "limits.current_error_A", EvidenceSource.INVERTER, "limits.current_error_s", True,
    ),
    Interlock(
        Trip.TORQUE_IMPLAUSIBLE,
        "the measured torque was further than limits.torque_error_Nm from the set-point",
        "limits.torque_error_Nm", EvidenceSource.BRIDGE, "limits.torque_error_s",
    ),
    Interlock(
        Trip.BRAKE_TEMPERATURE,
        "the brake's disc is more than 10 K hotter than brake.temperature_max_C",
        "brake.temperature_max_C", EvidenceSource.LOOP, 0.02,
    ),
    Interlock(  # by ticks: the driver takes a line for open from a Hello on, samples or none
        Trip.ENABLE_LINE, "the bridge reports the enable line open while the drive is enabled",
        "", EvidenceSource.LOOP, 0.005,
    ),
    Interlock(
        Trip.CHANNEL,
        "a slow channel was beyond its trip limit, or one with such a limit was broken or silent: "
        "found within its period, timeout_s and 0.05 s",
        "channels.trip_above, channels.trip_below, channels.timeout_s",
    ),
)  # fmt: skip
"""In the order of their bits, which are `Trip`'s: the first of several causes in one tick is the
earliest here."""

INTERLOCK = {row.trip: row for row in INTERLOCKS}


def trips_from(source: EvidenceSource) -> int:
    """Return the bits of the interlocks with this source of evidence."""
    return sum(row.trip.value for row in INTERLOCKS if row.source is source)
