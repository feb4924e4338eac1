"""The bridge board as its own firmware, run by QEMU, in place of `board` and `link`.

The rig's encoder and torque go into the machine's feed; the enable line comes back from there. The
bytes of the link are passed on between the machine and the pseudo-terminal that the host opens: a
host that does not read loses bytes, as on a serial line, and does not stop the machine.
"""

from collections.abc import Iterator
from pathlib import Path

from motord.config import Config, ConfigError
from motord.config.faults import Fault, Timeline
from motord.emulate import EmulatorError
from motord.emulate.bench import SensorReading
from motord.emulate.board import Board
from motord.emulate.bridge.feed import FeedDecoder, input_frame
from motord.emulate.bridge.link import PtyEnd
from motord.emulate.bridge.qemu import Qemu, receive, send
from motord.wire.bridge.frames import DELIMITER, Frame, Numbered

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
