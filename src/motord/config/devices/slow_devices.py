"""`[brake] [drive]`: the devices that the supervisor talks to, by Modbus."""

from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, model_validator

from motord.config.base import BitRate, Section
from motord.config.devices import DeviceConfig
from motord.config.timing import CONNECT_MAX_S, INTERVALS_MIN, SLOW_SILENCE_MAX_S
from motord.section import not_too_small
from motord.section.quantities import AngularSpeed, Scale, Temperature, Torque

RegisterKind = Literal["u16", "i16", "u32", "i32"]
"""How a number lies in registers: unsigned or two's complement, one register or two."""
BRAKE_MARGIN_K = 10.0
"""Further than temperature_max_C, at which the supervisor takes the torque away."""


def register_counts(kind: RegisterKind) -> tuple[int, int]:
    """Return the least and the greatest count that registers of a kind can hold."""
    bits = int(kind[1:])
    return (0, 2**bits - 1) if kind[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


class ModbusLinkConfig(Section):
    """How a Modbus device is reached: TCP, or a serial line."""

    transport: Literal["tcp", "rtu"] = "tcp"
    """`tcp`, or `rtu` on a serial port."""
    host: str = "127.0.0.1"
    """Host of a device on TCP."""
    tcp_port: Annotated[int, Field(ge=1, le=65535)] = 502
    """Port of a device on TCP."""
    serial_port: str = ""
    """Port of a device on RTU; two devices may share it."""
    baud: BitRate = 115_200
    """Baud rate of the serial port."""
    parity: Literal["N", "E", "O"] = "N"
    """Parity: none, even or odd."""
    stop_bits: Literal[1, 2] = 1
    """Stop bits."""
    unit: Annotated[int, Field(ge=1, le=247)] = 1
    """Address of the device on the line, or behind a gateway."""
    timeout_s: Annotated[float, Field(gt=0, le=5)] = 0.1
    """Time for one request; longer than the device ever takes."""

    @property
    def place(self) -> str:
        """Where the device is, for messages."""
        return f"{self.host}:{self.tcp_port}" if self.transport == "tcp" else self.serial_port

    @model_validator(mode="after")
    def _needs_serial_port(self) -> "ModbusLinkConfig":
        if self.transport == "rtu" and not self.serial_port:
            raise ValueError('transport = "rtu" needs serial_port')
        return self


class ModbusConfig(ModbusLinkConfig):
    """`[brake.modbus]`, `[drive.modbus]`: transport, unit and registers of a Modbus device."""

    watchdog_s: Annotated[float, Field(ge=0, le=SLOW_SILENCE_MAX_S)] = 0.0
    """As set in the device: it drops its set-point to zero after so long without one. 0: never,
    which a drive must not have."""
    connect_timeout_s: Annotated[float, Field(gt=0, le=CONNECT_MAX_S)] = 2.0
    """The device has to answer within this time of the start."""
    word_order: Literal["big", "little"] = "big"
    """Which half of a 32-bit number comes first."""
    setpoint_register: Annotated[int, Field(ge=0, le=65535)] = 0
    """Counted from 0: 40001 in many manuals."""
    setpoint_kind: RegisterKind = "u16"
    """`u` unsigned, `i` two's complement; one register of 16 bits or two."""
    setpoint_scale: Scale = 0.0001
    """Excitation (1: full), or rad/s, per count."""
    read_table: Literal["holding", "input"] = "holding"
    """Where status and value are read."""
    status_register: Annotated[int, Field(ge=0, le=65535)] = 16
    """Counted from 0."""
    status_ready_mask: Annotated[int, Field(ge=0, le=65535)] = 1
    """Bits that are all set when the device is ready; 0: it does not say."""
    status_fault_mask: Annotated[int, Field(ge=0, le=65535)] = 2
    """Bits of which any means a fault; 0: it does not say."""
    value_register: Annotated[int, Field(ge=0, le=65535)] = 17
    """Temperature of the brake's disc, actual speed of the drive."""
    value_kind: RegisterKind = "i16"
    """As setpoint_kind."""
    value_scale: Scale = 0.1
    """degC, or rad/s, per count."""

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


def shares_line(one: ModbusLinkConfig, other: ModbusLinkConfig) -> bool:
    """Return whether two devices are on one serial line, where one waits for the other."""
    return one.transport == other.transport == "rtu" and one.serial_port == other.serial_port


class _ModbusDevice(DeviceConfig):
    OWN: ClassVar = {
        "sim": None, "none": None, "modbus": ("modbus", "a table [brake.modbus] or [drive.modbus]")
    }  # fmt: skip

    modbus: ModbusConfig | None = None
    """Transport and registers, for `driver = "modbus"`."""
    poll_s: Annotated[
        float, Field(gt=0, le=SLOW_SILENCE_MAX_S / INTERVALS_MIN), AfterValidator(not_too_small)
    ] = 0.05
    """Time between two readings."""
    stale_after_s: Annotated[float, Field(gt=0, le=SLOW_SILENCE_MAX_S)] = 1.0
    """Without an answer for so long torque goes to zero, an external drive stops, and a plan is
    aborted."""


class BrakeConfig(_ModbusDevice):
    """`[brake]`: eddy-current brake, T = excitation^2 2 Tmax / (w/wc + wc/w)."""

    torque_max_Nm: Torque = 20.0
    """Largest torque, Tmax, at full excitation and the critical speed."""
    critical_speed_rad_s: AngularSpeed = 20.0
    """Speed of the largest torque, wc."""
    excitation_time_constant_s: Annotated[float, Field(ge=0, le=60)] = 0.2
    """Time constant of its current source and coil."""
    temperature_max_C: Temperature = 150.0
    """A hotter disc takes the torque to zero and stops an external drive; one 10 K hotter trips."""

    @property
    def trip_temperature_C(self) -> float:
        """A hotter disc trips."""
        return self.temperature_max_C + BRAKE_MARGIN_K


class DriveConfig(_ModbusDevice):
    """`[drive]`: the external motor that turns the rotor through a belt."""

    speed_max_rad_s: AngularSpeed = 15.0
    """Fastest set-point; of either sign, if the register of it has one."""

    @property
    def speed_min_rad_s(self) -> float:
        """The least set-point: 0 where its register has no sign, so that it turns one way only."""
        modbus = self.modbus if self.driver == "modbus" else None
        return 0.0 if modbus and modbus.setpoint_kind[0] == "u" else -self.speed_max_rad_s
