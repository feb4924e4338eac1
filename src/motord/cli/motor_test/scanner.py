"""The lines that a bar-code reader types, from a descriptor."""

import os
import select
import termios

KEPT_BYTES = 4096
"""Of a line that goes on and on, what is kept of it."""


class ScannedLines:
    """Lines of a terminal or a pipe; a line without its end is none."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._rest = b""

    def read(self) -> bytes | None:
        """Wait for the next line and return it without its end; None if no more can come."""
        while b"\n" not in self._rest:
            try:
                data = os.read(self._descriptor, KEPT_BYTES)
            except OSError:  # EIO: the terminal is gone
                data = b""
            if not data:
                return None
            self._rest = self._rest[:KEPT_BYTES] + data
        line, _, self._rest = self._rest.partition(b"\n")
        return line.removesuffix(b"\r")

    @property
    def unfinished(self) -> bytes:
        """What came after the last line that has an end."""
        return self._rest

    def discard_typed(self) -> bool:
        """Forget what was typed on a terminal and not read; return whether there was anything."""
        if not os.isatty(self._descriptor):
            return False
        typed = bool(self._rest or select.select([self._descriptor], [], [], 0)[0])
        termios.tcflush(self._descriptor, termios.TCIFLUSH)
        self._rest = b""
        return typed
