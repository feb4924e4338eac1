"""The bridge's frames in the data fields of CAN frames: one piece of a frame's body in each.

The first byte of a piece is 0x80 if it is the first of its body, 0x40 if the last, plus its number
modulo 64. A sender numbers all its pieces on and on, from body to body, so that a receiver sees
every loss, even one that would join the head of one body and the tail of another. The rest is
data: up to 7 bytes in classic CAN, up to 63 in CAN FD, whose last piece is filled with zeros up to
the next length that CAN FD has. The receiver knows the length of a body from its type.

The board's side is `firmware_bridge/protocol/can_pieces.c`.
"""

from motord.wire.bridge.frames import BODY_BYTES, Numbered, unpack
from motord.wire.bridge.stream import FrameDecoder
from motord.wire.can.frame_format import CLASSIC_BYTES, FD_BYTES, data_size
from motord.wire.sequence import SequenceCheck

FIRST = 0x80
LAST = 0x40
PIECE_NUMBERS = 64


def split(body: bytes, number: int, piece_bytes: int = CLASSIC_BYTES) -> list[bytes]:
    """Return the pieces of `body` (`frames.pack`), the first of them numbered `number`.

    `piece_bytes` is CLASSIC_BYTES or FD_BYTES. The next body's first number is
    (number + number of pieces) % PIECE_NUMBERS.
    """
    step = piece_bytes - 1
    pieces: list[bytes] = []
    for start in range(0, len(body), step):
        first = FIRST if start == 0 else 0
        last = LAST if start + step >= len(body) else 0
        head = first | last | (number + len(pieces)) % PIECE_NUMBERS
        piece = bytes((head,)) + body[start : start + step]
        pieces.append(piece.ljust(data_size(len(piece)), b"\0"))
    return pieces


class PieceJoiner:
    """Puts bodies together again; `errors` counts those given up for want of a piece."""

    def __init__(self) -> None:
        self.errors = 0
        self._body = b""
        self._size = 0  # of the body being joined, 0 between bodies
        self._expected = 0
        self._skipping = False  # the rest of a body that was given up

    def feed(self, piece: bytes) -> bytes | None:
        """Take the data field of a CAN frame; return the body it completes, if any.

        The body's length is that of its type; its CRC is not looked at.
        """
        head = piece[0] if piece else 0
        first, last = bool(head & FIRST), bool(head & LAST)
        if not 2 <= len(piece) <= FD_BYTES:
            self._give_up(last)
            return None
        if first:
            self._begin(piece[1])
        elif not self._size or head % PIECE_NUMBERS != self._expected:
            self._give_up(last)
            return None
        self._expected = (head + 1) % PIECE_NUMBERS
        room = self._size - len(self._body)
        data, filling = piece[1 : 1 + room], piece[1 + room :]
        self._body += data
        if not data or (last and len(data) < room) or not _fills(filling, len(piece), last):
            self._give_up(last)
            return None
        if not last:
            return None
        self._size = 0
        return self._body

    def _begin(self, code: int) -> None:
        if self._size:
            self.errors += 1
        self._skipping = False
        self._body = b""
        self._size = BODY_BYTES.get(code, 0)

    def _give_up(self, last: bool) -> None:
        """Count a body that cannot be completed, once; what follows of it means nothing."""
        if not self._skipping:
            self.errors += 1
        self._size = 0
        self._skipping = not last


def _fills(filling: bytes, piece_length: int, last: bool) -> bool:
    """Say whether what is in a piece beyond its body may be there."""
    return not filling or (last and piece_length > CLASSIC_BYTES and not any(filling))


class PieceDecoder(FrameDecoder):
    """Turns pieces into frames, as `wire.bridge.stream.StreamDecoder` does with bytes."""

    def __init__(self, check: SequenceCheck | None = None) -> None:
        super().__init__(check)
        self._joiner = PieceJoiner()

    def feed(self, piece: bytes) -> Numbered | None:
        """Return the frame that `piece` completes, if it counts."""
        before = self._joiner.errors
        body = self._joiner.feed(piece)
        for _ in range(self._joiner.errors - before):
            self._check.corrupt()
        return None if body is None else self._counting(unpack(body))
