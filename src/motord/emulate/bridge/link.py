"""The emulated board's end of its wire; a pseudo-terminal for a serial line."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path

from motord.emulate.bench import SensorReading
from motord.emulate.board import Board
from motord.emulate.devices import NEVER_NS
from motord.emulate.disturbance import Disturbance
from motord.emulate.pty import Pty
from motord.wire.bridge.frames import SEQUENCE_MODULUS, Frame, Numbered, encode
from motord.wire.bridge.stream import StreamDecoder
from motord.wire.sequence import SequenceCheck


class BoardEnd(ABC):
    """The board's end of whatever wire; `pty_name` is "" where there is no pseudo-terminal."""

    pty_name = ""

    def __init__(self) -> None:
        self.faults = Disturbance()
        self._sequence = 0

    @abstractmethod
    def fileno(self) -> int:
        """Return the descriptor that is readable when the host has sent something, or -1."""

    @abstractmethod
    def receive(self, now_ns: int) -> Iterator[tuple[int, Numbered]]:
        """Yield the frames since the last call, each with its time of arrival (monotonic ns)."""

    @abstractmethod
    def send(self, frame: Frame, now_ns: int = 0) -> bool:
        """Send a frame; False if there is no room and nothing of it went out.

        `now_ns` (monotonic) matters to frames that a fault makes late.
        """

    @abstractmethod
    def play(self, now_ns: int) -> None:
        """Send late frames that are due."""

    @abstractmethod
    def close(self) -> None:
        """Release the wire; may be called twice."""

    def sample(self, board: Board, reading: SensorReading, now_ns: int) -> None:
        """Take the sample of this instant; send it if the board is to."""
        clipped = reading.torque_clipped != 0
        sample = board.sample(now_ns, reading.encoder_gray, reading.torque_counts, clipped)
        if board.streaming:
            board.dropped += not self.send(sample, now_ns)

    def greet(self, board: Board) -> None:
        """Send the Hello of a board that was reset."""
        self._reset()
        self.send(board.hello())

    def _reset(self) -> None:
        """Number frames anew; of a frame whose begin has come nothing is kept."""
        self._sequence = 0

    def _count(self) -> None:
        """Note that a frame with the number `_sequence` has been sent."""
        self._sequence = (self._sequence + 1) % SEQUENCE_MODULUS

    @property
    def _undisturbed(self) -> bool:
        return not self.faults.active and self.faults.next_ns == NEVER_NS


class PtyEnd(BoardEnd):
    """A board behind a pseudo-terminal, which the host opens as its serial port."""

    def __init__(self, port: Path) -> None:
        """Make the pseudo-terminal and its symlink. Raises EmulatorError."""
        super().__init__()
        self._pty = Pty(port)
        self.pty_name = self._pty.name

    def fileno(self) -> int:
        """Return the descriptor that is readable when the host has sent something."""
        return self._pty.fileno()

    def play(self, now_ns: int) -> None:
        """Send late frames that are due."""
        for _, encoded in self.faults.due(now_ns):
            self._pty.write(encoded)

    def close(self) -> None:
        """Remove the port; may be called twice."""
        self._pty.close()

    def _read(self) -> bytes:
        """Return what of the host's bytes arrives."""
        data = self._pty.read()
        if self.faults.active and data:
            data = self.faults.to_device(data) or b""
        return data

    def _write(self, encoded: bytes, now_ns: int) -> bool:
        """Send an encoded frame; False if the host has let the line fill up."""
        if self._undisturbed:
            return self._pty.write(encoded)
        sent = [self._pty.write(each) for each in self.faults.to_host(now_ns, None, encoded)]
        return all(sent)


class BoardLink(PtyEnd):
    """The board's end of the serial line."""

    def __init__(self, port: Path, check: SequenceCheck) -> None:
        """Make the pseudo-terminal and its symlink. Raises EmulatorError.

        `check` is the board's, which judges the numbers of the frames.
        """
        super().__init__(port)
        self._check = check
        self._decoder = StreamDecoder(check)
        self._polled_ns = 0

    def receive(self, now_ns: int) -> Iterator[tuple[int, Numbered]]:
        """Yield the frames since the last call, each with its time of arrival (monotonic ns).

        Bytes carry no time. One frame is read as soon as it has come; several have come one after
        the other while the process was kept waiting, and are spread over that time.
        """
        waiting_ns = now_ns - self._polled_ns
        self._polled_ns = now_ns
        data = self._read()
        if not data:
            return
        numbered = self._decoder.feed(data)
        for place, frame in enumerate(numbered, start=1):
            yield now_ns - waiting_ns * (len(numbered) - place) // len(numbered), frame

    def send(self, frame: Frame, now_ns: int = 0) -> bool:
        """Send a frame; False if the host has let the line fill up and there is no room.

        Such a frame has no number: it is the board that misses it, and counts it once.
        """
        sent = self._write(encode(frame, self._sequence), now_ns)
        if sent:
            self._count()
        return sent

    def _reset(self) -> None:
        super()._reset()
        self._decoder = StreamDecoder(self._check)
