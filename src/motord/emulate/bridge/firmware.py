"""The bridge board as its own firmware, run by QEMU, in place of `board` and `link`.

The rig's encoder and torque go into the machine's feed; the enable line comes back from there. The
bytes of the link are passed on between the machine and the pseudo-terminal that the host opens: a
host that does not read loses bytes, as on a serial line, and does not stop the machine.

The feed's frames are those of `firmware_bridge/boards/qemu/feed.h`: seven bits in each byte, the
top bit set in the first byte of a frame, a check in the last.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from motord.config import Config, ConfigError
from motord.config.faults import Fault, Timeline
from motord.emulate import EmulatorError
from motord.emulate.bench import SensorReading
from motord.emulate.board import Board
from motord.emulate.bridge.link import PtyEnd
from motord.emulate.bridge.qemu import Qemu, receive, send
from motord.wire.bridge.frames import DELIMITER, Frame, Numbered

LINES_MAX = (1 << 12) - 1
TORQUE_MIDDLE = 1 << 15
TORQUE_MAX = (1 << 16) - 1
_BEGINS = 0x80
_LOW_BITS = 0x7F
_REPORT_BYTES = 6
_CHECK_START = 0x35


class FirmwareReport(NamedTuple):
    """What the firmware reports: its enable line, and when (its clock, us modulo 2^32)."""

    line_closed: bool
    t_us: int


def input_frame(encoder_gray: int, torque_counts: int) -> bytes:
    """Return the frame that sets the board's inputs.

    `torque_counts` as in a Sample, 0 at no torque; beyond the ADC's ends it stays at the end.
    """
    torque = min(max(torque_counts + TORQUE_MIDDLE, 0), TORQUE_MAX)
    word = (encoder_gray & LINES_MAX) << 16 | torque
    frame = bytes((_BEGINS | word >> 21, *(word >> shift & _LOW_BITS for shift in (14, 7, 0))))
    return frame + bytes((_check(frame),))


class FeedDecoder:
    """Takes the firmware's frames out of a stream of bytes."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> list[FirmwareReport]:
        """Return the reports in `data`; a frame that is cut off or corrupt is left out."""
        begun = self._begun + data
        starts = [place for place, byte in enumerate(begun) if byte & _BEGINS]
        frames = [begun[start : start + _REPORT_BYTES] for start in starts]
        self._begun = begun[starts[-1] :] if starts and len(frames[-1]) < _REPORT_BYTES else b""
        return [_report(frame) for frame in frames if _is_good(frame)]


def _is_good(frame: bytes) -> bool:
    if len(frame) < _REPORT_BYTES or any(byte & _BEGINS for byte in frame[1:]):
        return False
    return frame[-1] == _check(frame[:-1])


def _report(frame: bytes) -> FirmwareReport:
    t_us = frame[0] & 0x0F
    for byte in frame[1:-1]:
        t_us = t_us << 7 | byte
    return FirmwareReport(bool(frame[0] & 0x10), t_us)


def _check(frame: bytes) -> int:
    return (sum(frame) + _CHECK_START) & _LOW_BITS


FEED_HZ = 2000
"""How often the rig's encoder and torque are fed, and what the firmware has sent is passed on."""


def check_fault(fault: Fault) -> None:
    """Raise ValueError for a fault that the firmware cannot have."""
    if fault.kind == "bridge_clock":
        raise ValueError("bridge_clock: the clock of a firmware in QEMU cannot be moved")


def check_faults(timeline: Timeline) -> None:
    """Raise ConfigError for faults that the firmware cannot have."""
    try:
        for fault in timeline.fault:
            check_fault(fault)
    except ValueError as error:
        raise ConfigError(str(error)) from None


class FirmwareBoard(Board):
    """What the bench knows of the board: its enable line. The firmware does the rest by itself."""

    def __init__(self, config: Config, machine: Qemu) -> None:
        super().__init__(config, 0)
        self.rate_Hz = FEED_HZ
        self._machine = machine

    def receive(self, now_ns: int, numbered: Numbered) -> list[Frame]:
        """Return no answers: the firmware sends its own."""
        return []

    def expire(self, now_ns: int) -> None:
        """Do nothing: the firmware has a clock of its own."""

    def restart(self, now_ns: int) -> None:
        """Press the reset button."""
        self._machine.reset()


class FirmwareLink(PtyEnd):
    """The machine's link on a pseudo-terminal, and its feed."""

    def __init__(self, port: Path, machine: Qemu, board: FirmwareBoard) -> None:
        """Make the pseudo-terminal and its symlink. Raises EmulatorError."""
        super().__init__(port)
        self._machine = machine
        self._board = board
        self._feed = FeedDecoder()
        self._begun = b""  # of a frame to the host

    def receive(self, now_ns: int) -> Iterator[tuple[int, Numbered]]:
        """Pass on what has come on either side; there are no frames for the bench.

        Raises EmulatorError if the machine has ended.
        """
        if not self._machine.running:
            raise EmulatorError("the bridge's firmware: QEMU has ended; see what it said above")
        if data := self._read():
            send(self._machine.link, data)
        self._to_host(now_ns, receive(self._machine.link))
        for report in self._feed.feed(receive(self._machine.feed)):
            self._board.line_closed = report.line_closed
        return iter(())

    def send(self, frame: Frame, now_ns: int = 0) -> bool:
        """Send nothing: the firmware sends its own frames."""
        return True

    def sample(self, board: Board, reading: SensorReading, now_ns: int) -> None:
        """Give the board's inputs what the rig's sensors say now."""
        send(self._machine.feed, input_frame(reading.encoder_gray, reading.torque_counts))

    def greet(self, board: Board) -> None:
        """Reset the board, so that it sends its Hello."""
        self._machine.reset()

    def _to_host(self, now_ns: int, data: bytes) -> None:
        """Send the frames of the firmware that are complete."""
        *frames, self._begun = (self._begun + data).split(DELIMITER)
        for frame in frames:
            self._write(frame + DELIMITER, now_ns)
