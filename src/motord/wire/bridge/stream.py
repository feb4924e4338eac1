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
from motord.wire.sequence import SequenceCheck


class FrameDecoder:
    """Says which frames count: the good ones that are newer than the one before.

    A `Hello` starts a new count: the board has just started. Without one no number steps back: old
    frames, repeated by whatever is on the way, are none. With a `check` of the caller's, corrupt
    frames are counted there, and all good frames are handed on: their numbers are the caller's to
    judge.
    """

    def __init__(self, check: SequenceCheck | None = None) -> None:
        self._judges = check is None
        self._check = check or SequenceCheck(SEQUENCE_MODULUS)

    @property
    def errors(self) -> int:
        """Return the frames lost, corrupt or repeated so far; it never falls."""
        return self._check.errors

    def _counting(self, numbered: Numbered | None) -> Numbered | None:
        """Return a frame if it counts; None is a corrupt one."""
        if numbered is None:
            self._check.corrupt()
            return None
        if not self._judges:
            return numbered
        if type(numbered.frame) is Hello:
            self._check.restart()
        new = self._check.accept(numbered.sequence, may_restart=False)
        return numbered if new else None


class StreamDecoder(FrameDecoder):
    """Turns bytes into frames; how they were cut into pieces makes no difference."""

    def __init__(self, check: SequenceCheck | None = None) -> None:
        super().__init__(check)
        self._rest = b""
        self._overlong = False

    def feed(self, data: bytes) -> list[Numbered]:
        """Return the frames that `data` completes and that count, oldest first."""
        pieces = (self._rest + data).split(DELIMITER)
        self._rest = pieces.pop()
        frames: list[Numbered] = []
        for piece in pieces:
            if self._overlong:
                self._overlong = False
                self._check.corrupt()
            elif piece:
                fits = len(piece) <= MAX_STUFFED_BYTES
                numbered = self._counting(decode(piece) if fits else None)
                if numbered is not None:
                    frames.append(numbered)
        if len(self._rest) > MAX_STUFFED_BYTES:
            self._overlong = True
        if self._overlong:
            self._rest = b""
        return frames
