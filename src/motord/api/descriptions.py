"""Texts for trips and flags: for events, state, errors and the documentation."""

from motord.control.interlock_table import INTERLOCKS
from motord.schema import BridgeStatus, Flag, Trip

TRIP_MEANING: dict[Trip, str] = {row.trip: row.meaning for row in INTERLOCKS}
"""Meaning of each cause, with the key of the bench file that sets its limit."""

TRIP_ACTION: dict[Trip, str] = {
    Trip.OVER_CURRENT: "look at the phase currents before the trip: a peak in one phase points to "
    "its sensor or a short, an oscillation of all to the current controller; lower "
    "limits.current_A if the command itself came close",
    Trip.OVER_SPEED: "check that the brake answers and holds; lower the torque or raise the brake "
    "before the torque; a rotor that runs away at any torque is not aligned: `motord plan start "
    "align`",
    Trip.OVER_TORQUE: "look for a blow or a stop in the torque; check the sensor's gain and "
    "mounting; lower limits.torque_Nm if the command itself came close",
    Trip.I2T: "let the motor cool; lower the torque or rest between operating points; correct "
    "limits.i2t_current_A only by the motor's data sheet",
    Trip.ENCODER_STALE: "check cable and power of the bridge, and that no other board answers for "
    "it; if the loop was late at the same time, see `motord check --rt`",
    Trip.ENCODER_IMPLAUSIBLE: "look at encoder_gray before the trip: one bit that stands still or "
    "flickers is a broken line; check coupling and screen of the encoder's cable",
    Trip.TORQUE_STALE: "check the torque sensor's amplifier for saturation and its supply; check "
    "the bridge's ADC",
    Trip.INVERTER_STALE: "check the CAN bus (cable, termination, load) and that the inverter is "
    "on; if the loop was late at the same time, see `motord check --rt`",
    Trip.INVERTER_FAULT: "read the fault in the inverter's own tool (inverter_status in the ticks "
    "is its status word), clear it there, then reset; if it reports none, the enable line opened: "
    "emergency stop, or a bridge that was reset (its supply)",
    Trip.BUS_OFF: "check the CAN bus: bit rate, termination, a short; reset the CAN interface",
    Trip.LOOP_OVERRUN: "see what kept the loop from running: `motord check --rt`, other programs "
    "on its processor",
    Trip.SUPERVISOR_STALE: "see in the daemon's log what delayed it: memory, a stopped process, "
    "a busy computer",
    Trip.TEMPERATURE: "let the inverter cool; check its fan and heat sink; lower the torque",
    Trip.LINK_ERRORS: "check cables, screens and termination of both links; keep motor cables "
    "away from them",
    Trip.BUS_VOLTAGE: "too high: the rotor fed energy back, so brake more gently or give the "
    "supply a braking resistor; too low: check the supply's current limit and its cables",
    Trip.ENABLE_TIMEOUT: "the values say what is missing: check the enable line and the emergency "
    "stop, the bridge's cable (heartbeats), hosts of another protocol that bar it, the inverter's "
    "status; raise loop.enable_timeout_s if the inverter takes longer",
    Trip.BRIDGE_FAULT: "check the encoder's lines and the bridge's supply; bridge_status in the "
    "ticks says what the board found",
    Trip.FEEDBACK_INVALID: "find in the ticks which value is not a number; check the signal map "
    "and scaling of that device",
    Trip.CURRENT_IMPLAUSIBLE: "compare i_a_A to i_c_A with the commands before the trip: one phase "
    "that does not move is an open line or a broken sensor; all too small is a bus voltage too low "
    "for the speed",
    Trip.TORQUE_IMPLAUSIBLE: "compare torque_Nm with torque_set_Nm: a slow drift points to the "
    "sensor's amplifier; a torque that goes with the angle to the encoder (frozen, slipped, wrong "
    "offset) or a phase without current",
    Trip.BRAKE_TEMPERATURE: "let the brake's disc cool; rest between operating points",
    Trip.ENABLE_LINE: "the values say why the board opened it: heartbeats lost (its cable, or a "
    "loop that was late: see `motord check --rt`), or barred (end the host of another protocol); "
    "if neither, it was reset (its supply), or another host with the same identifier asked for an "
    "open line (a second motord: end it, or change [bridge.can] host_id)",
    Trip.CHANNEL: "the values of the trip name the channel: let it come back within its limits, or "
    "mend its sensor; `motord status` shows every channel, and why one is broken",
}
"""What to do about each cause before the reset."""


BRIDGE_ACTION: dict[BridgeStatus, str] = {
    BridgeStatus.FAULT: "the bridge board's self-test failed, so it keeps the enable line open: "
    "check its crystal, supply and the switch of the line, then reset the board",
    BridgeStatus.BARRED: "a host of another protocol asked the bridge board who it is, so it keeps "
    "the enable line open: end that program (an older motord, or one that sends with the host_id "
    "of [bridge.can]); motord asks the board anew by itself, then `motord reset` and enable",
    BridgeStatus.OTHER_BOARD: "another bridge board answered than the one that was opened, so none "
    "counts until that one alone answers: remove the other one (behind the port, or with board_id "
    "of [bridge.can]), then `motord reset` and enable",
}
"""What keeps the bridge board from closing the enable line, and what to do."""


LOOP_SILENT = "the loop publishes no ticks"
LOOP_STUCK = "the loop does not come up"
"""The faults of a loop whose process hangs, or was stopped: while it runs, and before."""
HANGING_REMEDY = "`motord reset` ends it and starts it again"
"""What to do about them."""
ENDED_REMEDY = "`motord reset` starts the loop again"
"""What to do about a loop that has ended."""


_BRIDGE_BITS = tuple((int(bit), text) for bit, text in BRIDGE_ACTION.items())
_TRIP_BITS = tuple((int(trip), trip.name) for trip in Trip if trip.name)
_FLAG_BITS = tuple((int(flag), flag.name) for flag in Flag if flag.name)
"""Integers: every state has these texts, and an enum takes fifty times as long to look at."""


def bridge_action(status: int) -> str:
    """Return what is wrong with the bridge board by its status word, and what to do; "" if all is
    well."""
    return "; ".join(text for bit, text in _BRIDGE_BITS if status & bit)


def trip_action(bits: int) -> str:
    """Return what to do about the causes in `bits`, in one line."""
    return "; ".join(TRIP_ACTION[trip] for trip in Trip if bits & trip)


def trip_names(bits: int) -> list[str]:
    """Return the names of the causes in `bits`, the lowest bit first."""
    return [name for bit, name in _TRIP_BITS if bits & bit]


def trip_text(bits: int) -> str:
    """Return the causes in `bits` with their meaning, in one line."""
    parts = [f"{trip.name} ({TRIP_MEANING[trip]})" for trip in Trip if bits & trip]
    return "; ".join(parts) or "no cause"


def flag_names(bits: int) -> list[str]:
    """Return the names of the flags in `bits`."""
    return [name for bit, name in _FLAG_BITS if bits & bit]
