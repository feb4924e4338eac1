"""The emulated board's port: frames in, frames out; a pseudo-terminal for a serial line."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path

from motord.emulate.bench import SensorReading
from motord.emulate.board import Board
from motord.emulate.devices import NEVER_NS
from motord.emulate.disturbance import Disturbance
from motord.emulate.pty import Pty
from motord.wire.bridge.frames import SEQUENCE_MODULUS, Frame, Numbered, encode
from motord.wire.bridge.sequence import SequenceCheck
from motord.wire.bridge.stream import StreamDecoder


class BoardEnd(ABC):
    """The board's end of whatever wire: what it says, over what `send` gives."""

    faults: Disturbance
    _sequence: int

    @abstractmethod
    def send(self, frame: Frame, now_ns: int = 0) -> bool:
        """Send a frame; False if there is no room.

        `now_ns` (monotonic) matters to frames that a fault makes late.
        """

    def sample(self, board: Board, reading: SensorReading, now_ns: int) -> None:
        """Send the sample of this instant, if the board is to."""
        if board.streaming:
            clipped = reading.torque_clipped != 0
            sample = board.sample(now_ns, reading.encoder_gray, reading.torque_counts, clipped)
            board.dropped += not self.send(sample, now_ns)

    def greet(self, board: Board) -> None:
        """Say who the board is and number frames anew, as a board does that was reset."""
        self._sequence = 0
        self.send(board.hello())


class BoardLink(BoardEnd):
    """The board's end of the serial line."""

    def __init__(self, port: Path, check: SequenceCheck) -> None:
        """Make the pseudo-terminal and its symlink. Raises EmulatorError.

        `check` is the board's, which judges the numbers of the frames.
        """
        self._pty = Pty(port)
        self._decoder = StreamDecoder(check)
        self._sequence = 0
        self._polled_ns = 0
        self.faults = Disturbance()

    @property
    def pty_name(self) -> str:
        """Return the name of the pseudo-terminal to which the port is a symlink."""
        return self._pty.name

    def fileno(self) -> int:
        """Return the descriptor that is readable when the host has sent something."""
        return self._pty.fileno()

    def receive(self, now_ns: int) -> Iterator[tuple[int, Numbered]]:
        """Yield the frames since the last call, each with its time of arrival (monotonic ns).

        Bytes carry no time. One frame is read as soon as it has come; several have come one after
        the other while the process was kept waiting, and are spread over that time.
        """
        waiting_ns = now_ns - self._polled_ns
        self._polled_ns = now_ns
        data = self._pty.read()
        if self.faults.active and data:
            data = self.faults.to_device(data) or b""
        if not data:
            return
        numbered = self._decoder.feed(data)
        for place, frame in enumerate(numbered, start=1):
            yield now_ns - waiting_ns * (len(numbered) - place) // len(numbered), frame

    def send(self, frame: Frame, now_ns: int = 0) -> bool:
        """Send a frame; False if the host has let the line fill up and there is no room.

        `now_ns` (monotonic) matters to frames that a fault makes late.
        """
        encoded = encode(frame, self._sequence)
        self._sequence = (self._sequence + 1) % SEQUENCE_MODULUS
        if not self.faults.active and self.faults.next_ns == NEVER_NS:
            return self._pty.write(encoded)
        sent = [self._pty.write(each) for each in self.faults.to_host(now_ns, None, encoded)]
        return all(sent)

    def play(self, now_ns: int) -> None:
        """Send late frames that are due."""
        for _, encoded in self.faults.due(now_ns):
            self._pty.write(encoded)

    def close(self) -> None:
        """Remove the port; may be called twice."""
        self._pty.close()
