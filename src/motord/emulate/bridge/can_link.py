"""The emulated board on CAN: its frames in pieces, on a channel the inverter may share."""

from collections.abc import Iterator

from motord.can_interface import new_message
from motord.config import BridgeCanConfig
from motord.emulate.bridge.link import BoardEnd
from motord.emulate.can import EmulatedBus
from motord.emulate.clock import HostClock
from motord.wire.bridge.frames import Frame, Numbered, pack
from motord.wire.bridge.segmentation import PIECE_NUMBERS, PieceDecoder, split
from motord.wire.can.frame_format import CLASSIC_BYTES, FD_BYTES
from motord.wire.sequence import SequenceCheck


class BoardCanLink(BoardEnd):
    """The board's end of the bus. Faults of the bridge's wire concern single pieces."""

    def __init__(self, config: BridgeCanConfig, clock: HostClock, check: SequenceCheck) -> None:
        """Open the channel. Raises EmulatorError.

        `check` is the board's, which judges the numbers of the frames.
        """
        super().__init__()
        self._config = config
        self._clock = clock
        self._piece_bytes = FD_BYTES if config.fd else CLASSIC_BYTES
        self._check = check
        self._decoder = PieceDecoder(check)
        self._number = 0
        self._bus = EmulatedBus(config, self.faults)

    def fileno(self) -> int:
        """Return the descriptor that is readable when something has come, -1 if there is none."""
        return self._bus.fileno()

    def receive(self, now_ns: int) -> Iterator[tuple[int, Numbered]]:
        """Yield the frames since the last call, each with its time of arrival (monotonic ns)."""
        for unix_ns, piece in self._bus.receive(self._config.host_id):
            numbered = self._decoder.feed(piece) if piece else None
            if numbered is not None:
                yield min(self._clock.monotonic_ns(unix_ns), now_ns), numbered

    def send(self, frame: Frame, now_ns: int = 0) -> bool:
        """Send a frame; False if the bus has no room for any of it.

        Such a frame has no number: it is the board that misses it. The host misses one of which a
        part found room.
        """
        pieces = split(pack(frame, self._sequence), self._number, self._piece_bytes)
        number = (self._number + len(pieces)) % PIECE_NUMBERS
        if not self._undisturbed:
            pieces = [sent for one in pieces for sent in self.faults.to_host(now_ns, None, one)]
        refused = self._bus.refused
        for piece in pieces:
            self._transmit(piece)
        if pieces and self._bus.refused - refused == len(pieces):
            return False
        self._count()
        self._number = number
        return True

    def play(self, now_ns: int) -> None:
        """Send late pieces that are due."""
        for _, piece in self.faults.due(now_ns):
            self._transmit(piece)

    def close(self) -> None:
        """Release the channel; may be called twice."""
        self._bus.close()

    def _reset(self) -> None:
        super()._reset()
        self._decoder = PieceDecoder(self._check)
        self._number = 0

    def _transmit(self, piece: bytes) -> None:
        self._bus.send(new_message(self._config.board_id, fd=self._config.fd, data=piece))
