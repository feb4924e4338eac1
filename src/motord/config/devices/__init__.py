"""`[inverter] [bridge]`: drivers, wires and timing of the devices in the loop."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import (
    Field,
    JsonValue,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from motord.config.base import BitRate, Section
from motord.config.devices.can_signals import CanopenConfig, CanSignalMap, DqConfig
from motord.config.timing import (
    CONNECT_MAX_S,
    DELAY_MAX_S,
    RATE_MAX_HZ,
    RATE_MIN_HZ,
    SETTLING_LAGS,
    SILENCE_MAX_S,
    SLOW_FEEDBACK_MAX_S,
)
from motord.section.quantities import Scale

SAMPLE_BYTES, HEARTBEAT_BYTES = 19, 6
"""Bodies of the two frames that are sent all the time (`wire.bridge.frames.BODY_BYTES`)."""
DEFAULT_BITRATE = 1_000_000

_CLASSIC_DATA, _CLASSIC_STUFFED_BITS, _CLASSIC_OTHER_BITS = 7, 34, 13
_FD_NOMINAL_BITS, _FD_OTHER_BITS = 32, 46
_STUFFING = 1.25


class CanBusConfig(Section):
    """A CAN channel: of the kernel (`socketcan`), or by any other interface of python-can.

    The bit rates are set when the bus is opened, but not on `socketcan`: there `ip link` sets them.
    """

    interface: str = "socketcan"
    """`socketcan`, the kernel's, or any other interface of python-can."""
    channel: str = "can0"
    """Name of the interface, as that kind of interface has it."""
    bitrate: BitRate | None = None
    """Nominal bit rate (bit/s); `socketcan` has it from `ip link`."""
    fd: bool = True
    """CAN FD."""
    data_bitrate: BitRate | None = None
    """Bit rate of the data of FD frames (bit/s)."""
    options: dict[str, str | int | float | bool] = Field(default_factory=dict)
    """Passed to python-can as they are; `socketcan` has none."""

    @property
    def place(self) -> str:
        """Where the device is, for messages."""
        return f"{self.interface} {self.channel}"


class CanConfig(CanBusConfig):
    """`[inverter.can]`: the bus, and the DBC with its signal map."""

    connect_timeout_s: Annotated[float, Field(gt=0, le=CONNECT_MAX_S)] = 2.0
    """Feedback has to come within this time of the start."""
    slow_stale_after_s: Annotated[float, Field(gt=0, le=SLOW_FEEDBACK_MAX_S)] = 0.5
    """A message of feedback without currents (status, bus voltage, temperature) that stays away for
    longer makes all feedback stale, as inverter.stale_after_s does where the currents stay away:
    until then a fault or a voltage in it is not seen. At least twice the time from one to the next,
    which its DBC may say (GenMsgCycleTime): one may be lost."""
    dbc: Path
    """The drive's DBC; next to the bench file, or `package:NAME`."""
    signals: CanSignalMap
    """Which signals of the DBC are command and feedback."""
    canopen: CanopenConfig = CanopenConfig()
    """What a CANopen drive is sent besides its command."""


class DeviceConfig(Section):
    """What the tables of all devices share.

    OWN: motord's own drivers, which have no settings, and the key that each needs, as a message
    names it.
    """

    OWN: ClassVar[Mapping[str, tuple[str, str] | None]] = {}

    driver: str = "sim"
    """A driver of motord, or of another package by the name of its entry point."""
    settings: dict[str, JsonValue] = Field(default_factory=dict)
    """Settings of a driver of another package, which states what they are."""

    @model_validator(mode="after")
    def _has_what_its_driver_needs(self) -> "DeviceConfig":
        if self.settings and self.driver in self.OWN:
            raise ValueError(
                f'driver = "{self.driver}" has no settings; they are for drivers of other packages'
            )
        needed = self.OWN.get(self.driver)
        if needed is not None and not getattr(self, needed[0]):
            raise ValueError(f'driver = "{self.driver}" needs {needed[1]}')
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

    Driver `sim` is simulated in the loop, `can` is for a drive that takes phase currents, `can-dq`
    for one that takes currents along the rotor's axes.
    """

    OWN: ClassVar = {"sim": None} | dict.fromkeys(
        ("can", "can-dq"), ("can", "a table [inverter.can]")
    )

    can: CanConfig | None = None
    """Bus, DBC and signals of a drive on CAN."""
    dq: DqConfig = DqConfig()
    """Axes of a drive that takes currents along d and q."""
    stale_after_s: Annotated[float, Field(gt=0, le=SILENCE_MAX_S)] = 0.02
    """Without feedback for so long it trips."""
    timeout_s: Annotated[float, Field(gt=0, le=SILENCE_MAX_S)] = 0.05
    """As set in the drive: it zeroes its currents after so long without a command."""
    actuation_delay_s: Annotated[float, Field(ge=0, le=DELAY_MAX_S)] = 0.0008
    """From the start of a tick until its current flows: dead time and the lag of the current loops.
    """
    lag_s: Annotated[float, Field(ge=0, le=DELAY_MAX_S)] = 0.0
    """How much of actuation_delay_s is that lag, 1 / (2 pi bandwidth)."""
    feedback_age_s: Annotated[float, Field(ge=0, le=SILENCE_MAX_S)] = 0.0
    """From the sampling of the currents until their frame arrives."""

    @model_validator(mode="after")
    def _lag_is_part_of_the_delay(self) -> "InverterConfig":
        if self.lag_s > self.actuation_delay_s:
            raise ValueError("lag_s is part of actuation_delay_s and cannot be above it")
        return self

    @model_validator(mode="after")
    def _takes_what_its_driver_sends(self) -> "InverterConfig":
        if self.can is None:
            return self
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
    def settling_s(self) -> float:
        """Time from the start of a tick until its current has settled."""
        return self.actuation_delay_s + SETTLING_LAGS * self.lag_s

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
    """CAN FD; false: classical frames."""
    host_id: Annotated[int, Field(ge=0, le=0x7FF)] = 0x110
    """Identifier of frames to the board."""
    board_id: Annotated[int, Field(ge=0, le=0x7FF)] = 0x190
    """Identifier of frames from the board."""

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

    OWN: ClassVar = {
        "sim": None,
        "can": ("can", "a table [bridge.can]"),
        "serial": ("port", 'port, for example port = "/dev/ttyACM0"'),
    }

    can: BridgeCanConfig | None = None
    """Bus and identifiers of a board on CAN."""
    port: str = ""
    """Serial port; better one of `/dev/serial/by-id/`, which survives a reboot."""
    baud: BitRate = 2_000_000
    """Baud rate of the serial port."""
    rate_Hz: Annotated[int, Field(ge=RATE_MIN_HZ, le=RATE_MAX_HZ)] | None = None
    """Samples of encoder and torque; left out: the loop's rate."""
    stale_after_s: Annotated[float, Field(gt=0, le=SILENCE_MAX_S)] = 0.02
    """Without a sample for so long it trips."""
    heartbeat_timeout_s: Annotated[float, Field(ge=0.001, le=SILENCE_MAX_S)] = 0.05
    """Without a heartbeat for so long the board opens the enable line."""
    connect_timeout_s: Annotated[float, Field(gt=0, le=CONNECT_MAX_S)] = 2.0
    """The board has to answer within this time of the start."""
    adc_V_per_count: Scale = 10.0 / 32768
    """Volts per count of the torque sensor's converter; a count may not be a torque error."""

    @property
    def place(self) -> str:
        """Where the board is, for messages; "" for a simulated one."""
        return self.can.place if self.driver == "can" and self.can is not None else self.port
