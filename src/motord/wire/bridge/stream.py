"""Frames out of a stream of bytes that arrives in any pieces, with noise and losses.

Whatever happens to the bytes, the decoder is back in step at the next delimiter, and a frame is
accepted only if its CRC is right.
"""

from motord.wire.bridge.frames import (
    DELIMITER,
    MAX_STUFFED_BYTES,
    SEQUENCE_MODULUS,
    Hello,
    Numbered,
    decode,
)
from motord.wire.bridge.sequence import SequenceCheck


class StreamDecoder:
    """Turns bytes into frames; how they were cut into pieces makes no difference.

    With a `check` of the caller's, corrupt frames are counted there, and all good frames are
    handed on: their numbers are the caller's to judge.
    """

    def __init__(self, check: SequenceCheck | None = None) -> None:
        self._rest = b""
        self._overlong = False
        self._judges = check is None
        self._check = check or SequenceCheck(SEQUENCE_MODULUS)

    @property
    def errors(self) -> int:
        """Return the frames lost, corrupt or repeated so far; it never falls."""
        return self._check.errors

    def feed(self, data: bytes) -> list[Numbered]:
        """Return the good frames that `data` completes, oldest first; repeated ones are left out.

        A `Hello` starts a new count: the board has just started.
        """
        pieces = (self._rest + data).split(DELIMITER)
        self._rest = pieces.pop()
        frames: list[Numbered] = []
        for piece in pieces:
            if self._overlong:
                self._overlong = False
                self._check.corrupt()
            elif piece:
                self._take(piece, frames)
        if len(self._rest) > MAX_STUFFED_BYTES:
            self._overlong = True
        if self._overlong:
            self._rest = b""
        return frames

    def _take(self, piece: bytes, frames: list[Numbered]) -> None:
        numbered = decode(piece) if len(piece) <= MAX_STUFFED_BYTES else None
        if numbered is None:
            self._check.corrupt()
            return
        if self._judges and type(numbered.frame) is Hello:
            self._check.restart()
        if not self._judges or self._check.accept(numbered.sequence):
            frames.append(numbered)
