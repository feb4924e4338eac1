"""The bridge board over CAN: the bodies of its frames in pieces, on a channel others may share."""

from motord.config import Config
from motord.config.devices import BridgeCanConfig
from motord.hal.bridge.board import Bridge
from motord.hal.can.base import CanFrame
from motord.hal.can.bus import open_bus
from motord.wire.bridge import frames
from motord.wire.bridge.segmentation import PIECE_NUMBERS, PieceDecoder, split
from motord.wire.can.frame_format import CLASSIC_BYTES, FD_BYTES


class CanLink:
    """A `BridgeLink` on a CAN channel, on which it receives the board's identifier alone."""

    openings = 1

    def __init__(self, config: BridgeCanConfig, name: str) -> None:
        """Open the channel. Raises DeviceError."""
        self.stamp_ns = 0
        self._host_id = config.host_id
        self._piece_bytes = FD_BYTES if config.fd else CLASSIC_BYTES
        self._bus = open_bus(config, name)
        self._bus.listen([config.board_id])
        self._decoder = PieceDecoder()
        self._number = 0
        self._pieces = 0
        self._waiting: list[CanFrame] = []

    @property
    def received(self) -> str:
        """What has arrived so far, as text."""
        return f"{self._pieces} CAN frames of something else" if self._pieces else ""

    @property
    def errors(self) -> int:
        """Return the frames lost, corrupt or refused so far, and error frames of the bus."""
        return self._decoder.errors + self._bus.state.errors

    def receive(self) -> list[frames.Numbered]:
        """Return the good frames whose pieces have all arrived."""
        arrived = [*self._waiting, *self._bus.receive()] if self._waiting else self._bus.receive()
        self._waiting = []
        found = []
        for _, piece, stamp_ns in arrived:
            numbered = self._decoder.feed(piece)
            if numbered is not None:
                self.stamp_ns = stamp_ns
                found.append(numbered)
        self._pieces += len(arrived)
        return found

    def send(self, frame: frames.Frame, number: int) -> None:
        """Send a frame, a CAN frame for each piece."""
        pieces = split(frames.pack(frame, number), self._number, self._piece_bytes)
        self._number = (self._number + len(pieces)) % PIECE_NUMBERS
        for piece in pieces:
            self._bus.send(self._host_id, piece)

    def wait(self, timeout_s: float) -> None:
        """Wait until something has arrived."""
        self._waiting += self._bus.receive(timeout_s)

    def close(self) -> None:
        """Release the channel."""
        self._bus.close()


class CanBridge(Bridge):
    """A `BridgeDriver` for a board on CAN."""

    def __init__(self, config: Config) -> None:
        """Take channel, rates and scales from `config`; nothing is opened."""
        can = config.bridge.can
        assert can is not None  # a rule of the bench file
        name = f"bridge on {can.place}"
        super().__init__(
            config,
            name,
            "are the identifiers in [bridge.can], its bit rate and fd those of the board?",
            lambda: CanLink(can, name),
        )
