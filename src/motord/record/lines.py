"""Lines of text out of a pipe, without waiting."""

import os

_READ_AT_ONCE_BYTES = 1 << 16


class LineReader:
    """Reads lines from a descriptor that does not block. `ended`: the writer has closed it."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._rest = b""
        self.ended = False

    def read(self) -> list[bytes]:
        """Return the whole lines that have come since the last call, without their ends."""
        while not self.ended:
            try:
                piece = os.read(self._descriptor, _READ_AT_ONCE_BYTES)
            except BlockingIOError:
                break
            self.ended = not piece
            self._rest += piece
        *lines, self._rest = self._rest.split(b"\n")
        return lines
