"""The other ends of the wires, in threads: a drive and a bridge board that tests can upset."""

import math
import os
import select
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import pytest

from motord.config import CanConfig, Config, MotorConfig, packaged
from motord.config.devices import BridgeCanConfig
from motord.hal import countdown
from motord.hal.bridge.board import Bridge
from motord.schema import BridgeStatus, InverterStatus
from motord.wire.bridge import frames
from motord.wire.bridge.segmentation import PIECE_NUMBERS, PieceDecoder, split
from motord.wire.bridge.stream import StreamDecoder
from motord.wire.can import dbc
from motord.wire.can.codec import InverterCodec, MessageCodec
from motord.wire.can.frame_format import CLASSIC_BYTES, EXTENDED, FD_BYTES
from tests.support import patience
from tests.support.patience import PATIENCE_S
from tests.support.ports import free_port

PERIOD_S = 0.001
CONNECT_S = 10.0

CHANNEL = "239.74.163.77"
SOCKETCAN = os.environ.get("MOTORD_TEST_CAN", "")
"""A virtual CAN interface of the kernel, up and with an MTU of 72, that tests may use alone."""
SIGNALS = {
    "command_i_A": tuple(f"CurrentCommand.Current{p}" for p in "ABC"),
    "command_enable": "CurrentCommand.Enable",
    "command_counter": "CurrentCommand.Counter",
    "command_crc": "CurrentCommand.Checksum",
    "feedback_i_A": tuple(f"PhaseFeedback.Current{p}" for p in "ABC"),
    "feedback_u_V": tuple(f"PhaseFeedback.Voltage{p}" for p in "ABC"),
    "feedback_u_bus_V": "InverterStatus.BusVoltage",
    "feedback_temperature_C": "InverterStatus.Temperature",
    "feedback_status": "InverterStatus.Status",
    "feedback_counter": ("PhaseFeedback.Counter", "InverterStatus.Counter"),
    "feedback_crc": ("PhaseFeedback.Checksum", "InverterStatus.Checksum"),
}
DQ_SIGNALS = {
    "command_i_d_A": "DqCommand.CurrentD",
    "command_i_q_A": "DqCommand.CurrentQ",
    "command_enable": "DqCommand.Mode",
    "command_enable_value": 9,
    "command_constants": {"DqCommand.Profile": 2},
    "command_counter": "DqCommand.Counter",
    "command_crc": "DqCommand.Checksum",
    "feedback_i_d_A": "DqFeedback.CurrentD",
    "feedback_i_q_A": "DqFeedback.CurrentQ",
    "feedback_u_d_V": "DqFeedback.VoltageD",
    "feedback_u_q_V": "DqFeedback.VoltageQ",
    "feedback_u_bus_V": "DriveStatus.BusVoltage",
    "feedback_temperature_C": "DriveStatus.Temperature",
    "feedback_status": "DriveStatus.Status",
    "feedback_counter": ("DqFeedback.Counter", "DriveStatus.Counter"),
    "feedback_crc": ("DqFeedback.Checksum", "DriveStatus.Checksum"),
}
MOTOR = MotorConfig(
    name="test",
    pole_pairs=8,
    slots=48,
    counts=4096,
    rated_torque_Nm=6.0,
    connection="independent",
    back_emf=({"order": 1, "amplitude_V_s_per_rad": 0.206},),
)


def encode_feedback(
    codec: InverterCodec, values: Mapping[str, float], counter: int
) -> list[tuple[MessageCodec, bytes]]:
    """Every feedback message with its payload."""
    return [(m, m.encode([values[slot] for slot in m.slots], counter)) for m in codec.feedback]


def until(condition: Callable[[], Any]) -> Any:
    """Return what `condition` returns once it is true, looking several times in a period.

    Conditions read drivers, which take a bridge for silent that is read less often than by a loop.
    """
    return patience.until(condition, look_s=PERIOD_S / 4)


def give_up_once(condition: Callable[[], bool], patch: pytest.MonkeyPatch) -> None:
    """Let drivers that open give up once `condition()`, so that their timeout may be long.

    For a busy computer may keep the other end waiting.
    """
    late_s = {False: 0.0, True: math.inf}
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + late_s[condition()])
    patch.setattr(countdown, "time", clock)


def give_up_once_received(driver: Bridge, patch: pytest.MonkeyPatch) -> None:
    """Let a bridge that opens give up once something has come."""
    give_up_once(lambda: driver._link is not None and bool(driver._link.received), patch)


def never_ask(driver: Any, patch: pytest.MonkeyPatch) -> None:
    """Let a bridge, or that of a rig, not ask a board that a busy computer keeps silent who it is.

    The answer begins a new session, with frames of its own.
    """
    patch.setattr(getattr(driver, "_bridge", driver), "_silence_ns", round(PATIENCE_S * 1e9))


def can_config(interface: str = "udp_multicast", **changes: Any) -> CanConfig:
    """Return a bus of its own, so that tests that run at the same time do not share frames."""
    port = free_port()  # multicast groups on one port share their frames
    own: dict[str, Any] = {"channel": f"test-{port}"}
    if interface == "udp_multicast":
        own = {"channel": CHANNEL, "options": {"port": port, "hop_limit": 0}}
    elif interface == "socketcan":
        own = {"channel": SOCKETCAN or "nocan0"}
    return CanConfig(
        **{
            "interface": interface,
            "dbc": packaged("inverter.dbc"),
            "signals": SIGNALS,
            "connect_timeout_s": CONNECT_S,
            **own,
            **changes,
        }
    )


def bridge_can_config(interface: str = "udp_multicast", **changes: Any) -> BridgeCanConfig:
    """Return a bus of its own for a bridge board."""
    bus = can_config(interface).model_dump(include={"interface", "channel", "options"})
    return BridgeCanConfig(**bus, **changes)


def bench(
    can: CanConfig | None = None,
    port: str = "/dev/null",
    bridge_can: BridgeCanConfig | None = None,
    **bridge: Any,
) -> Config:
    """Return a bench with these wires; with a star for a drive that takes d and q."""
    can = can or can_config("virtual")
    rotating = can.signals.rotating
    return Config(
        motor=MOTOR.model_copy(update={"connection": "star"}) if rotating else MOTOR,
        inverter={"driver": "can-dq" if rotating else "can", "can": can},
        bridge={
            "driver": "serial",
            "port": port,
            "can": bridge_can,
            "connect_timeout_s": CONNECT_S,
            "adc_V_per_count": 0.001,
            **bridge,
        },
        torque_sensor={"gain_Nm_per_V": 2.0},
    )


class Peer:
    """A thread that calls `step`, which waits for `left_s` at most, until it is closed."""

    def __init__(self) -> None:
        self.silent = False
        self.corrupt = 0  # frames to spoil
        self.lose = 0  # frames to leave out
        self._stopping = False
        self._due_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def step(self) -> None:
        raise NotImplementedError

    def release(self) -> None:
        raise NotImplementedError

    def stop(self) -> None:
        """End the thread; from then on the peer does what the test calls."""
        self._stopping = True
        self._thread.join()

    def close(self) -> None:
        self.stop()
        self.release()

    def left_s(self) -> float:
        """Return the time until `step` is to speak again."""
        return max(self._due_s - time.monotonic(), 0.0)

    def due(self) -> bool:
        """Return whether it is time to speak; then the next time is a period from now."""
        if self.left_s() > 0:
            return False
        self._due_s = time.monotonic() + PERIOD_S
        return True

    def _run(self) -> None:
        while not self._stopping:
            self.step()


class Drive(Peer):
    """An inverter on CAN: answers with `values`, keeps the newest command."""

    def __init__(self, config: CanConfig, bus: Any = None) -> None:
        """Sit on `bus`, or open that of the config by python-can."""
        self.codec = dbc.load(config)
        self.commands = 0
        self.corrupt_commands = 0
        self.i_A: tuple[float, ...] = (9.0, 9.0, 9.0)
        self.enable = True
        ready = self.codec.status_word(InverterStatus.READY | InverterStatus.ENABLE_LINE)
        self.values = {
            "i_a_A": 1.0,
            "i_b_A": -2.5,
            "i_c_A": 1.5,
            "u_a_V": 3.0,
            "u_b_V": -6.0,
            "u_c_V": 3.0,
            "u_bus_V": 24.0,
            "temperature_C": 41.5,
            "status": ready,
            "i_d_A": 0.0,
            "i_q_A": 0.0,
            "u_d_V": 0.0,
            "u_q_V": 0.0,
        }
        self._config = config
        self._counter = 0
        self.bus: Any = bus or can.Bus(
            config.channel, config.interface, ignore_config=True, fd=config.fd, **config.options
        )
        super().__init__()

    def step(self) -> None:
        self.receive(self.left_s())
        if self.due() and not self.silent:
            self.speak()

    def receive(self, timeout_s: float = 0.0) -> None:
        message = self.bus.recv(timeout_s)
        while message is not None:
            if message.arbitration_id == self.codec.command.identifier:
                self._obey(bytes(message.data))
            message = self.bus.recv(0)

    def send(self, message: can.Message) -> None:
        self.bus.send(message)

    def release(self) -> None:
        self.bus.shutdown()

    def _obey(self, payload: bytes) -> None:
        command = self.codec.decode_command(payload)
        if command is None:
            self.corrupt_commands += 1
            return
        self.i_A, self.enable = command
        self.commands += 1

    def speak(self) -> None:
        self._counter += 1
        if self.lose:
            self.lose -= 1
            return
        spoil = self.corrupt > 0
        if spoil:  # before it is sent: a test that has seen it may ask for the next one
            self.corrupt -= 1
        for codec, payload in encode_feedback(self.codec, self.values, self._counter):
            data = bytearray(payload)
            if spoil:
                data[0] ^= 0x10
            self.bus.send(
                can.Message(
                    arbitration_id=codec.identifier,
                    is_extended_id=codec.key >= EXTENDED,
                    is_fd=self._config.fd,
                    data=data,
                )
            )


@dataclass
class Identity:
    """What a board says of itself."""

    protocol: int = frames.PROTOCOL
    firmware: int = frames.firmware(1, 2, 3)
    board: bytes = b"fake"
    serial: int = 7
    counts: int = 4096
    layout: int = frames.LAYOUT_HASH
    rates_Hz: list[int] = field(default_factory=list)  # those it can do; none: all


class Board(Peer):
    """A bridge board behind a pseudo-terminal; the host opens `port`."""

    _unsent = b""

    def __init__(self, identity: Identity | None = None) -> None:
        self.identity = identity or Identity()
        self.line_closed = True
        self.heartbeats = 0
        self.deaf = False  # to heartbeats
        self.configured: frames.Configure | None = None
        self.lose_configure = 0  # of the next, lost on the way
        self.starts = self.hellos = 0
        self.streaming = False
        self.errors = 0
        self.dropped = 0
        self.torque_counts = 1500
        self.encoder_gray = 0x5A5
        self.status = 0
        self.clock_offset_us = 0
        self.reboot = False
        self.raw = b""  # to be sent as it is
        self._rate_Hz, self._timeout_us = 1000, 50_000
        self._heartbeat = (0, 0)
        self._sequence = 0
        self._decoder = StreamDecoder()
        self.connect()
        super().__init__()

    def connect(self) -> None:
        self._unsent = b""
        self._fd, self._host_fd = os.openpty()
        tty.setraw(self._host_fd)
        os.set_blocking(self._fd, False)
        self.port = str(Path(tempfile.mkdtemp(prefix="motord-test-")) / "board")
        Path(self.port).symlink_to(os.ttyname(self._host_fd))

    def clock_us(self) -> int:
        return (time.monotonic_ns() // 1000 + self.clock_offset_us) % frames.CLOCK_MODULUS_US

    def step(self) -> None:
        if self.reboot:
            self.reboot = False
            self.streaming = False
            self._sequence = 0
            self._rate_Hz, self._timeout_us = 1000, 50_000
            self.clock_offset_us = -(time.monotonic_ns() // 1000)
            self._send(self._hello())
        self.receive(self.left_s())
        if self.raw:
            self.transmit(self.raw)
            self.raw = b""
        if self.due() and self.streaming and not self.silent and self.drained():
            self.speak()

    def receive(self, timeout_s: float = 0.0) -> None:
        if select.select([self._fd], [], [], timeout_s)[0]:
            for number, frame in self._decoder.feed(os.read(self._fd, 65536)):
                self._obey(number, frame)

    def speak(self) -> None:
        status = self.status | (BridgeStatus.ENABLE_LINE if self.line_closed else 0)
        self._send(frames.Sample(self.clock_us(), self.encoder_gray, self.torque_counts, status))
        self._send(self._account())

    def release(self) -> None:
        """Leave nothing; the port's name first: its terminal's may be another test's next."""
        with suppress(FileNotFoundError):
            Path(self.port).unlink()
            Path(self.port).parent.rmdir()
        for fd in (self._fd, self._host_fd):
            if fd >= 0:
                os.close(fd)
        self._fd = self._host_fd = -1

    def _obey(self, number: int, frame: frames.Frame) -> None:
        if isinstance(frame, frames.Heartbeat):
            if self.deaf:
                return
            self.heartbeats += 1
            self._heartbeat = (number, self.clock_us())
            self.line_closed = bool(frame.enable)
        elif isinstance(frame, frames.HelloRequest):
            self.hellos += 1
            self._send(self._hello())
        elif isinstance(frame, frames.Configure) and self.lose_configure:
            self.lose_configure -= 1
        elif isinstance(frame, frames.Configure):
            self.configured = frame
            possible = self.identity.rates_Hz or [frame.rate_Hz]
            self._rate_Hz = frame.rate_Hz if frame.rate_Hz in possible else possible[0]
            self._timeout_us = frame.heartbeat_timeout_us
            self._send(self._account())
        else:
            self.streaming = isinstance(frame, frames.Start)
            self.starts += self.streaming
            self._send(self._account())

    def _hello(self) -> frames.Hello:
        me = self.identity
        return frames.Hello(
            me.protocol, me.firmware, me.board, me.serial, self._rate_Hz, me.counts, me.layout
        )

    def _account(self) -> frames.Status:
        number, t_us = self._heartbeat
        return frames.Status(
            self.clock_us(),
            self.status,
            number,
            t_us,
            self.heartbeats,
            self.errors,
            self.dropped,
            self._rate_Hz,
            self._timeout_us,
            int(self.streaming),
        )

    def _send(self, frame: frames.Frame) -> None:
        data = self.coded(frame)
        self._sequence = (self._sequence + 1) % frames.SEQUENCE_MODULUS
        if self.lose:
            self.lose -= 1
            return
        if self.corrupt:
            self.corrupt -= 1
            data[3] ^= 0x41
        self.transmit(data)

    def coded(self, frame: frames.Frame) -> bytearray:
        return bytearray(frames.encode(frame, self._sequence))

    def transmit(self, data: bytes | bytearray) -> None:
        self._unsent += data
        self.drained()

    def drained(self) -> bool:
        """Send what the line takes; return whether that is all, so that more may be said.

        A host that does not read for a while misses nothing by that: it is load that decides.
        """
        if self._unsent:
            with suppress(BlockingIOError):
                self._unsent = self._unsent[os.write(self._fd, self._unsent) :]
        return not self._unsent


class CanBoard(Board):
    """A bridge board on CAN, with other nodes' frames between its own."""

    def __init__(self, config: BridgeCanConfig, identity: Identity | None = None) -> None:
        self._config = config
        super().__init__(identity)

    def connect(self) -> None:
        can_ = self._config
        self._pieces = PieceDecoder()
        self._number = 0
        self._bus = can.Bus(
            can_.channel, can_.interface, ignore_config=True, fd=can_.fd, **can_.options
        )

    def receive(self, timeout_s: float = 0.0) -> None:
        message = self._bus.recv(timeout_s)
        while message is not None:
            if message.arbitration_id == self._config.host_id and message.data:
                numbered = self._pieces.feed(bytes(message.data))
                if numbered is not None:
                    self._obey(*numbered)
            message = self._bus.recv(0)

    def coded(self, frame: frames.Frame) -> bytearray:
        return bytearray(frames.pack(frame, self._sequence))

    def transmit(self, data: bytearray) -> None:
        size = FD_BYTES if self._config.fd else CLASSIC_BYTES
        pieces = split(bytes(data), self._number, size)
        self._number = (self._number + len(pieces)) % PIECE_NUMBERS
        for piece in pieces:
            self.put(self._config.board_id, piece)
            self.put(self._config.board_id + 1, b"\xc0" + piece[1:])

    def put(self, identifier: int, data: bytes) -> None:
        self._bus.send(
            can.Message(
                arbitration_id=identifier,
                is_extended_id=False,
                is_fd=self._config.fd,
                data=data,
            )
        )

    def release(self) -> None:
        self._bus.shutdown()
