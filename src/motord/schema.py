"""The tick record, defined once.

From `TICK` come the ring's numpy dtype, the MCAP schema and the Zenoh payload
(`motord.wire.ticks.blocks`), and the tables of docs/recording.md. A field number is a promise:
never renumber, only append.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from functools import cache
from typing import Any, Literal

import numpy as np

PROTO_KINDS = {
    "double": "<f8",
    "float": "<f4",
    "sfixed64": "<i8",
    "fixed64": "<u8",
    "sfixed32": "<i4",
    "fixed32": "<u4",
}
"""Fixed-width protobuf types and the numpy type of each."""

INT32_MAX = 2**31 - 1
"""What an sfixed32 holds at most; longer times are given as this."""


def record_dtype(fields: list[Any]) -> np.dtype[np.void]:
    """Return an aligned dtype whose elements have attributes, compiled and interpreted alike."""
    return np.dtype((np.record, np.dtype(fields, align=True)))


def joined(blocks: Sequence[np.ndarray]) -> np.ndarray:
    """Return blocks (n_k,) of one structured type, one block at least, as one (sum of n_k,)."""
    dtype = blocks[0].dtype
    if dtype.hasobject or any(block.dtype != dtype for block in blocks):
        return np.concatenate(blocks, dtype=dtype)
    return np.concatenate([as_bytes(block) for block in blocks]).view(dtype)


def rows_of(records: np.ndarray, chosen: np.ndarray | slice) -> np.ndarray:
    """Return records (n,) of a structured type that a mask (n,) chooses, or a slice."""
    return as_bytes(records)[chosen].view(records.dtype)


def as_bytes(records: np.ndarray) -> np.ndarray:
    """Return a view of records of a structured type without objects as plain bytes of its size.

    numpy copies and chooses records field by field, which takes ten times as long.
    """
    return records.view(_plain_dtype(records.dtype.itemsize))


@cache  # some hundred blocks are joined every second
def _plain_dtype(size: int) -> np.dtype[np.void]:
    return np.dtype((np.void, size))


@dataclass(frozen=True)
class Field:
    """One field of a fixed-layout record: protobuf number and type, unit ("" if none), meaning."""

    number: int
    name: str
    kind: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Record:
    """A fixed-layout record: the protobuf message `motord.<name>` with `fields`, all written."""

    name: str
    meaning: str
    fields: tuple[Field, ...]

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The numpy dtype, wide fields first, so that every field is naturally aligned."""
        ordered = sorted(self.fields, key=lambda f: -np.dtype(PROTO_KINDS[f.kind]).itemsize)
        return record_dtype([(f.name, PROTO_KINDS[f.kind]) for f in ordered])


class State(IntEnum):
    """State of the drive, decided in the loop."""

    OFF = 0  # off; a cause bars enabling and trips nothing
    READY = 1  # disabled, but supervised: a cause trips
    ENABLED = 2  # power stage on, torque as set
    TRIPPED = 3  # zero current until a reset


class Request(IntEnum):
    """What the supervisor asks of the loop; each is carried out once."""

    NONE = 0
    ENABLE = 1  # arm, then apply torque
    DISABLE = 2  # ramp to zero, then READY
    STOP = 3  # zero now, OFF
    RESET = 4  # leave TRIPPED, if no cause is left


class Compensate(IntFlag):
    """Which parts of the calibration the reference currents use."""

    CURRENTS = 1 << 0  # alpha and beta
    COGGING = 1 << 1  # the cogging torque
    LEARNED = 1 << 2  # the learned torque


Compensation = Literal["off", "on", "calibration", "currents", "cogging"]
"""Choices of them, by their names in settings and requests."""


class Trip(IntFlag):
    """Causes of a trip. Several can be up in one tick; `trip_bits` holds them all."""

    OVER_CURRENT = 1 << 0
    OVER_SPEED = 1 << 1
    OVER_TORQUE = 1 << 2
    I2T = 1 << 3
    ENCODER_STALE = 1 << 4
    ENCODER_IMPLAUSIBLE = 1 << 5
    TORQUE_STALE = 1 << 6
    INVERTER_STALE = 1 << 7
    INVERTER_FAULT = 1 << 8
    BUS_OFF = 1 << 9
    LOOP_OVERRUN = 1 << 10
    SUPERVISOR_STALE = 1 << 11
    TEMPERATURE = 1 << 12
    LINK_ERRORS = 1 << 13
    BUS_VOLTAGE = 1 << 14
    ENABLE_TIMEOUT = 1 << 15
    BRIDGE_FAULT = 1 << 16
    FEEDBACK_INVALID = 1 << 17
    CURRENT_IMPLAUSIBLE = 1 << 18
    TORQUE_IMPLAUSIBLE = 1 << 19
    BRAKE_TEMPERATURE = 1 << 20
    ENABLE_LINE = 1 << 21
    CHANNEL = 1 << 22


class Flag(IntFlag):
    """What else is true of a tick."""

    LATE = 1 << 0  # woke later than half a period
    AFTER_GAP = 1 << 1  # at least one tick before this one was skipped
    CURRENT_LIMITED = 1 << 2  # the command was cut to limits.current_A
    TORQUE_LIMITED = 1 << 3  # the set-point was cut to what the limits allow
    CURRENTS_COMPENSATED = 1 << 4  # alpha and beta of the calibration applied
    COGGING_COMPENSATED = 1 << 5  # cogging torque of the calibration applied
    RAMPING = 1 << 6  # torque set-point not yet at the one asked for
    # bit 7 is 0 in all recordings: it was reserved and never set
    NEW_ENCODER = 1 << 8  # encoder sample newer than the tick before
    NEW_INVERTER = 1 << 9  # feedback newer than the tick before
    SIMULATED = 1 << 10  # the rig runs in the loop
    SUPERVISOR_ABSENT = 1 << 11  # it gave no sign of life in time
    LEARNED_COMPENSATED = 1 << 12  # the learned torque of the calibration applied
    POSITION_AGED = 1 << 13  # enabled, but no current: the newest position is too old


class InverterStatus(IntFlag):
    """What motord understands of any drive's status word (tick field `inverter_status`)."""

    READY = 1 << 0  # power stage on and following the current commands
    FAULT = 1 << 1  # the drive says that it has a fault
    BUS_OFF = 1 << 2  # the CAN controller is off the bus
    COMMAND_TIMEOUT = 1 << 3  # no command reached the drive in time
    ENABLE_LINE = 1 << 4  # the drive sees its enable line closed


class BridgeStatus(IntFlag):
    """What motord understands of any bridge's status word (tick field `bridge_status`)."""

    ENABLE_LINE = 1 << 0  # the line to the inverter is closed
    HEARTBEAT_LOST = 1 << 1  # no heartbeat came in time, the line is open; or none is acknowledged
    TORQUE_INVALID = 1 << 2  # the torque sample is not to be trusted (saturated, ADC error)
    ENCODER_INVALID = 1 << 3  # the encoder lines are not to be trusted
    FAULT = 1 << 4  # the board's self-test failed
    BARRED = 1 << 5  # a host of another protocol asked: the line is open until motord asks anew
    OTHER_BOARD = 1 << 6  # set by motord: another board answered; none counts until one is alone


FAULT_COUNT_SHIFT, FAULT_COUNT_MODULUS = 8, 128
"""In a simulated or emulated bench, `bridge_status` from this bit on counts the faults injected so
far, modulo 128, so that every recording says when each began."""


def _tick_fields() -> tuple[Field, ...]:
    rows = (
        ("t_ns", "sfixed64", "ns", "Unix time of the encoder and torque sample"),
        ("tick", "fixed64", "", "counter of loop periods; a gap is a skipped period"),
        ("encoder_count", "sfixed32", "", "decoded position, 0 to counts - 1, rising forwards"),
        ("encoder_gray", "fixed32", "", "encoder lines as read (Gray code)"),
        ("angle_rad", "float", "rad", "estimated mechanical angle at t_ns, 0 to 2 pi"),
        ("speed_rad_s", "float", "rad/s", "estimated mechanical speed"),
        ("i_a_A", "float", "A", "sensed current, phase a"),
        ("i_b_A", "float", "A", "sensed current, phase b"),
        ("i_c_A", "float", "A", "sensed current, phase c"),
        ("i_cmd_a_A", "float", "A", "commanded current, phase a"),
        ("i_cmd_b_A", "float", "A", "commanded current, phase b"),
        ("i_cmd_c_A", "float", "A", "commanded current, phase c"),
        ("u_a_V", "float", "V", "voltage, phase a"),
        ("u_b_V", "float", "V", "voltage, phase b"),
        ("u_c_V", "float", "V", "voltage, phase c"),
        ("u_bus_V", "float", "V", "DC bus voltage"),
        ("torque_Nm", "float", "Nm", "measured torque, as the sensor gives it"),
        ("torque_set_Nm", "float", "Nm", "torque set-point in force after ramp and limits"),
        ("speed_set_rad_s", "float", "rad/s", "speed the plan or the operator asks for"),
        ("state", "fixed32", "", "0 OFF, 1 READY, 2 ENABLED, 3 TRIPPED"),
        ("trip_bits", "fixed32", "", "latched causes, see Trip; in OFF: what bars enabling"),
        ("flags", "fixed32", "", "see Flag"),
        ("missed", "fixed32", "", "periods skipped since the loop started"),
        ("wake_late_ns", "sfixed32", "ns", "wake-up after the deadline"),
        ("work_ns", "sfixed32", "ns", "time from wake-up to the end of the tick before"),
        ("plan_point", "sfixed32", "", "operating point being captured, -1 for none"),
        ("angle_predicted_rad", "float", "rad", "angle at which the command takes effect"),
        ("i_age_ns", "sfixed32", "ns", "age at t_ns of the sensed currents and voltages"),
        ("sample_age_ns", "sfixed32", "ns", "age of the encoder sample when the tick began"),
        ("cogging_comp_Nm", "float", "Nm", "cogging torque that the command makes up for"),
        ("temperature_C", "float", "degC", "inverter temperature"),
        ("inverter_status", "fixed32", "", "status word of the inverter"),
        ("bridge_status", "fixed32", "", "status word of the bridge"),
        ("link_errors", "fixed32", "", "frames lost or corrupt since start, both links"),
        ("brake_set", "float", "1", "brake excitation asked for, 0 to 1"),
        ("brake_temperature_C", "float", "degC", "brake disc temperature, nan if unknown"),
        ("drive_set_rad_s", "float", "rad/s", "external drive speed asked for"),
        ("setpoint_seq", "fixed32", "", "number of the set-point in force"),
        ("first_trip", "fixed32", "", "the first cause alone"),
    )
    return tuple(Field(number, *row) for number, row in enumerate(rows, start=1))


TICK = Record("Tick", "One period of the control loop.", _tick_fields())
TICK_DTYPE = TICK.dtype

TRUTH = Record(
    "Truth",
    "What a simulated rig really did: known to the simulator, never to the controller.",
    tuple(
        Field(number, *row)
        for number, row in enumerate(
            (
                ("t_ns", "sfixed64", "ns", "Unix time"),
                ("angle_rad", "double", "rad", "mechanical angle, not wrapped"),
                ("speed_rad_s", "float", "rad/s", "mechanical speed"),
                ("torque_Nm", "float", "Nm", "electromagnetic plus cogging torque"),
                ("torque_em_Nm", "float", "Nm", "electromagnetic torque"),
                ("torque_cog_Nm", "float", "Nm", "cogging torque"),
                ("torque_brake_Nm", "float", "Nm", "brake torque"),
                ("i_a_A", "float", "A", "current that flows in phase a"),
                ("i_b_A", "float", "A", "current that flows in phase b"),
                ("i_c_A", "float", "A", "current that flows in phase c"),
                ("enable_line", "fixed32", "", "1 while the enable line is closed"),
                ("inverter_on", "fixed32", "", "1 while the power stage is on"),
                ("energy_dc_J", "double", "J", "energy from the DC supply since the start"),
                ("energy_shaft_J", "double", "J", "work at the torque sensor since the start"),
                ("winding_C", "float", "degC", "temperature of the windings, mean of the phases"),
                ("magnet_C", "float", "degC", "temperature of the magnets"),
                ("housing_C", "float", "degC", "temperature of the housing"),
            ),
            start=1,
        )
    ),
)
TRUTH_DTYPE = TRUTH.dtype
