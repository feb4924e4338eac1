"""`[inverter] [bridge] [brake] [drive]`: drivers, wires and timing of the devices."""

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    Field,
    JsonValue,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from motord.config.base import Finite, NonNegative, Positive, Section
from motord.config.can_signals import CanSignalMap, DqConfig
from motord.config.timing import DELAY_MAX_S, RATE_MAX_HZ, RATE_MIN_HZ, SILENCE_MAX_S

SAMPLE_BYTES, HEARTBEAT_BYTES = 19, 6
"""Bodies of the two frames that are sent all the time (`wire.bridge.frames.BODY_BYTES`)."""
DEFAULT_BITRATE = 1_000_000

_CLASSIC_DATA, _CLASSIC_STUFFED_BITS, _CLASSIC_OTHER_BITS = 7, 34, 13
_FD_NOMINAL_BITS, _FD_OTHER_BITS = 32, 46
_STUFFING = 1.25


class CanBusConfig(Section):
    """A CAN channel: of the kernel (`socketcan`), or by any other interface of python-can.

    The bit rates are set when the bus is opened, but not on `socketcan`: there `ip link` sets them.
    `options` are python-can's for that interface; `socketcan` has none.
    """

    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: Annotated[int, Field(gt=0)] | None = None
    fd: bool = True
    data_bitrate: Annotated[int, Field(gt=0)] | None = None
    options: dict[str, str | int | float | bool] = Field(default_factory=dict)

    @property
    def place(self) -> str:
        """Where the device is, for messages."""
        return f"{self.interface} {self.channel}"


class CanConfig(CanBusConfig):
    """`[inverter.can]`: the bus, and the DBC with its signal map."""

    connect_timeout_s: Positive = 2.0
    dbc: Path
    signals: CanSignalMap


class DeviceConfig(Section):
    """What the tables of all devices share.

    `settings` are those of a driver of another package, which states what they are
    (`hal.driver_settings`); motord's own drivers (`OWN`) have none.
    """

    OWN: ClassVar[tuple[str, ...]] = ()

    driver: str = "sim"
    settings: dict[str, JsonValue] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _settings_are_of_a_driver_that_has_them(self) -> "DeviceConfig":
        if self.settings and self.driver in self.OWN:
            raise ValueError(
                f'driver = "{self.driver}" has no settings; they are for drivers of other packages'
            )
        return self

    @model_serializer(mode="wrap")
    def _without_settings_that_are_not_there(
        self, serialise: SerializerFunctionWrapHandler
    ) -> dict[str, Any]:
        content: dict[str, Any] = serialise(self)
        if not self.settings:
            content.pop("settings", None)
        return content


class InverterConfig(DeviceConfig):
    """`[inverter]`: the drive's driver and timing.

    actuation_delay_s is from the start of a tick until its current flows, dead time and the lag
    of the current loops together; lag_s is how much of it is that lag (1 / (2 pi bandwidth)).
    driver "can" is for a drive that takes phase currents, "can-dq" for one that takes currents
    along the rotor's axes, which `dq` describes.
    """

    OWN = ("sim", "can", "can-dq")

    can: CanConfig | None = None
    dq: DqConfig = DqConfig()
    stale_after_s: Annotated[float, Field(gt=0, le=SILENCE_MAX_S)] = 0.02
    timeout_s: Annotated[float, Field(gt=0, le=SILENCE_MAX_S)] = 0.05
    actuation_delay_s: Annotated[float, Field(ge=0, le=DELAY_MAX_S)] = 0.0008
    lag_s: NonNegative = 0.0
    feedback_age_s: NonNegative = 0.0

    @model_validator(mode="after")
    def _lag_is_part_of_the_delay(self) -> "InverterConfig":
        if self.lag_s > self.actuation_delay_s:
            raise ValueError("lag_s is part of actuation_delay_s and cannot be above it")
        return self

    @model_validator(mode="after")
    def _needs_can(self) -> "InverterConfig":
        if self.driver not in ("can", "can-dq"):
            return self
        if self.can is None:
            raise ValueError(f'driver = "{self.driver}" needs a table [inverter.can]')
        if self.driver == "can" and self.can.signals.rotating:
            raise ValueError(
                'driver = "can" takes phase currents: can.signals needs command_i_A, or take '
                'driver = "can-dq"'
            )
        if self.driver == "can-dq" and not self.can.signals.rotating:
            raise ValueError(
                'driver = "can-dq" takes currents along d and q: can.signals needs command_i_q_A, '
                'or take driver = "can"'
            )
        return self

    @property
    def q_only(self) -> bool:
        """True if the drive makes current along q alone."""
        return self.driver == "can-dq" and self.can is not None and self.can.signals.q_only


def classic_bits(data_bytes: int) -> int:
    """Return the most bits of a classical CAN frame with an 11-bit identifier, pause included."""
    stuffed = _CLASSIC_STUFFED_BITS + 8 * data_bytes
    return stuffed + (stuffed - 1) // 4 + _CLASSIC_OTHER_BITS


def body_s(body_bytes: int, fd: bool, bitrate: int, data_bitrate: int) -> float:
    """Return the most time that the pieces of a frame with this body take on the bus."""
    if fd:  # one piece of up to 64 bytes; head and tail at the nominal bit rate
        data_bits = (8 * (body_bytes + 1) + _FD_OTHER_BITS) * _STUFFING
        return _FD_NOMINAL_BITS * _STUFFING / bitrate + data_bits / data_bitrate
    whole, rest = divmod(body_bytes, _CLASSIC_DATA)
    bits = whole * classic_bits(_CLASSIC_DATA + 1) + (classic_bits(rest + 1) if rest else 0)
    return bits / bitrate


class BridgeCanConfig(CanBusConfig):
    """`[bridge.can]`: the bus of the board, and the identifiers (11 bit) of both directions."""

    fd: bool = False
    host_id: Annotated[int, Field(ge=0, le=0x7FF)] = 0x110
    board_id: Annotated[int, Field(ge=0, le=0x7FF)] = 0x190

    @model_validator(mode="after")
    def _identifiers_apart(self) -> "BridgeCanConfig":
        if self.host_id == self.board_id:
            raise ValueError("host_id and board_id must differ")
        return self

    def load(self, sample_Hz: float, heartbeat_Hz: float) -> float:
        """Return the part of the bus that samples and heartbeats take at worst (1: all of it)."""
        bitrate = self.bitrate or DEFAULT_BITRATE
        rates = (self.fd, bitrate, self.data_bitrate or bitrate)
        sample_s, heartbeat_s = body_s(SAMPLE_BYTES, *rates), body_s(HEARTBEAT_BYTES, *rates)
        return sample_Hz * sample_s + heartbeat_Hz * heartbeat_s


class BridgeConfig(DeviceConfig):
    """`[bridge]`: the board that samples encoder and torque sensor, by serial port or CAN."""

    OWN = ("sim", "can", "serial")

    can: BridgeCanConfig | None = None
    port: str = ""
    baud: Annotated[int, Field(gt=0)] = 2_000_000
    rate_Hz: Annotated[int, Field(ge=RATE_MIN_HZ, le=RATE_MAX_HZ)] | None = None
    stale_after_s: Annotated[float, Field(gt=0, le=SILENCE_MAX_S)] = 0.02
    heartbeat_timeout_s: Annotated[float, Field(ge=0.001, le=SILENCE_MAX_S)] = 0.05
    connect_timeout_s: Positive = 2.0
    adc_V_per_count: Positive = 10.0 / 32768

    @property
    def place(self) -> str:
        """Where the board is, for messages; "" for a simulated one."""
        return self.can.place if self.driver == "can" and self.can is not None else self.port

    @model_validator(mode="after")
    def _needs_port(self) -> "BridgeConfig":
        if self.driver == "serial" and not self.port:
            raise ValueError('driver = "serial" needs port, for example port = "/dev/ttyACM0"')
        return self

    @model_validator(mode="after")
    def _needs_can(self) -> "BridgeConfig":
        if self.driver == "can" and self.can is None:
            raise ValueError('driver = "can" needs a table [bridge.can]')
        return self


RegisterKind = Literal["u16", "i16", "u32", "i32"]
"""How a number lies in registers: unsigned or two's complement, one register or two."""


class ModbusConfig(Section):
    """`[brake.modbus]`, `[drive.modbus]`: transport, unit and registers of a Modbus device.

    `timeout_s` is for one request. `watchdog_s` is when the device itself drops its set-point
    to zero if nobody writes it (0 = never, not for a drive): set in the device, and followed by
    the emulated one.
    """

    transport: Literal["tcp", "rtu"] = "tcp"
    host: str = "127.0.0.1"
    tcp_port: Annotated[int, Field(ge=1, le=65535)] = 502
    serial_port: str = ""
    baud: Annotated[int, Field(gt=0)] = 115_200
    parity: Literal["N", "E", "O"] = "N"
    stop_bits: Literal[1, 2] = 1
    unit: Annotated[int, Field(ge=1, le=247)] = 1
    timeout_s: Annotated[float, Field(gt=0, le=5)] = 0.1
    watchdog_s: NonNegative = 0.0
    word_order: Literal["big", "little"] = "big"
    setpoint_register: Annotated[int, Field(ge=0, le=65535)] = 0
    setpoint_kind: RegisterKind = "u16"
    setpoint_scale: Positive = 0.0001
    read_table: Literal["holding", "input"] = "holding"
    status_register: Annotated[int, Field(ge=0, le=65535)] = 16
    status_ready_mask: Annotated[int, Field(ge=0, le=65535)] = 1
    status_fault_mask: Annotated[int, Field(ge=0, le=65535)] = 2
    value_register: Annotated[int, Field(ge=0, le=65535)] = 17
    value_kind: RegisterKind = "i16"
    value_scale: Positive = 0.1

    @property
    def place(self) -> str:
        """Where the device is, for messages."""
        return f"{self.host}:{self.tcp_port}" if self.transport == "tcp" else self.serial_port

    @model_validator(mode="after")
    def _needs_serial_port(self) -> "ModbusConfig":
        if self.transport == "rtu" and not self.serial_port:
            raise ValueError('transport = "rtu" needs serial_port')
        return self

    @model_validator(mode="after")
    def _registers_apart(self) -> "ModbusConfig":
        taken: dict[int, str] = {}
        blocks = [
            ("status_register", self.status_register, "u16"),
            ("value_register", self.value_register, self.value_kind),
        ]
        if self.read_table == "holding":
            blocks.append(("setpoint_register", self.setpoint_register, self.setpoint_kind))
        for name, first, kind in blocks:
            for address in range(first, first + (2 if kind.endswith("32") else 1)):
                if address in taken:
                    raise ValueError(f"{name} and {taken[address]} both use register {address}")
                taken[address] = name
        return self


def shares_line(one: ModbusConfig, other: ModbusConfig) -> bool:
    """Return whether two devices are on one serial line, where one waits for the other."""
    return one.transport == other.transport == "rtu" and one.serial_port == other.serial_port


class _ModbusDevice(DeviceConfig):
    OWN = ("sim", "none", "modbus")

    modbus: ModbusConfig | None = None
    poll_s: Positive = 0.05
    stale_after_s: Positive = 1.0

    @model_validator(mode="after")
    def _needs_modbus(self) -> "_ModbusDevice":
        if self.driver == "modbus" and self.modbus is None:
            raise ValueError('driver = "modbus" needs a table [brake.modbus] or [drive.modbus]')
        return self


class BrakeConfig(_ModbusDevice):
    """`[brake]`: eddy-current brake, T = excitation^2 2 Tmax / (w/wc + wc/w)."""

    torque_max_Nm: Positive = 20.0
    critical_speed_rad_s: Positive = 20.0
    excitation_time_constant_s: NonNegative = 0.2
    temperature_max_C: Finite = 150.0


class DriveConfig(_ModbusDevice):
    """`[drive]`: the external motor that turns the rotor through a belt."""

    speed_max_rad_s: Positive = 15.0
