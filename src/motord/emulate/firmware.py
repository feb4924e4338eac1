"""The bridge board as its own firmware, run by QEMU, in place of `board` and `link`.

The rig's encoder and torque go into the machine's feed; the enable line comes back from there. The
bytes of the link are handed on between the machine and the pseudo-terminal that the host opens: a
host that does not read loses bytes, as on a serial line, and does not stop the machine.
"""

from collections.abc import Iterator
from pathlib import Path

from motord.config import Config, ConfigError
from motord.config.faults import Fault, Timeline
from motord.emulate import EmulatorError
from motord.emulate.bench import SensorReading
from motord.emulate.board import Board
from motord.emulate.devices import NEVER_NS
from motord.emulate.disturbance import Disturbance
from motord.emulate.feed import FeedDecoder, values
from motord.emulate.pty import Pty
from motord.emulate.qemu import Qemu, receive, send
from motord.wire.bridge.frames import DELIMITER, Frame, Numbered

FEED_HZ = 2000
"""How often the rig's encoder and torque are fed, and what the firmware has sent is handed on."""


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


class FirmwareLink:
    """The machine's link on a pseudo-terminal, and its feed. Used as `link.BoardLink` is."""

    def __init__(self, port: Path, machine: Qemu, board: FirmwareBoard) -> None:
        """Make the pseudo-terminal and its symlink. Raises EmulatorError."""
        self._machine = machine
        self._board = board
        self._pty = Pty(port)
        self._feed = FeedDecoder()
        self._begun = b""  # of a frame to the host
        self.faults = Disturbance()

    @property
    def pty_name(self) -> str:
        """Return the name of the pseudo-terminal to which the port is a symlink."""
        return self._pty.name

    def fileno(self) -> int:
        """Return the descriptor that is readable when the host has sent something."""
        return self._pty.fileno()

    def receive(self, now_ns: int) -> Iterator[tuple[int, Numbered]]:
        """Hand on what has come on either side; there are no frames for the bench.

        Raises EmulatorError if the machine has ended.
        """
        if not self._machine.running:
            raise EmulatorError("the bridge's firmware: QEMU has ended; see what it said above")
        data: bytes | None = self._pty.read()
        if data and self.faults.active:
            data = self.faults.to_device(data)
        if data:
            send(self._machine.link, data)
        self._to_host(now_ns, receive(self._machine.link))
        for told in self._feed.feed(receive(self._machine.feed)):
            self._board.line_closed = told.line_closed
        return iter(())

    def send(self, frame: Frame, now_ns: int = 0) -> bool:
        """Send nothing: the firmware sends its own frames."""
        return True

    def sample(self, board: Board, reading: SensorReading, now_ns: int) -> None:
        """Give the board's inputs what the rig's sensors say now."""
        send(self._machine.feed, values(reading.encoder_gray, reading.torque_counts))

    def play(self, now_ns: int) -> None:
        """Send late frames that are due."""
        for _, encoded in self.faults.due(now_ns):
            self._pty.write(encoded)

    def greet(self, board: Board) -> None:
        """Reset the board, so that it says who it is."""
        self._machine.reset()

    def close(self) -> None:
        """Remove the port; may be called twice."""
        self._pty.close()

    def _to_host(self, now_ns: int, data: bytes) -> None:
        """Send the frames of the firmware that are complete."""
        if not data:
            return
        *frames, self._begun = (self._begun + data).split(DELIMITER)
        undisturbed = not self.faults.active and self.faults.next_ns == NEVER_NS
        for frame in frames:
            encoded = frame + DELIMITER
            if undisturbed:
                self._pty.write(encoded)
            else:
                for each in self.faults.to_host(now_ns, None, encoded):
                    self._pty.write(each)
