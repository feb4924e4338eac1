"""A serial port under python-can's slcan interface, read in bulk and never waited for.

That interface reads byte by byte, with two system calls each, waits a millisecond when there is
nothing, and after each frame until it is transmitted. The loop can afford none of it.
"""

import errno
import fcntl
import os
from typing import Any

import can
import serial

_CHUNK_BYTES = 1 << 16
_IN_USE = "another driver or program has the port open; only SocketCAN channels can be shared"
_LINE_END = b"\r"
_ASCII = bytes(range(128)) + b"?" * 128
"""slcan would never get past a byte that is no character of its lines."""


class BulkPort:
    """What slcan uses of a `serial.Serial`, whose descriptor it takes over. Raises OSError."""

    def __init__(self, port: serial.Serial) -> None:
        """Take over an open port. Raises OSError if another driver or program did so before."""
        self.write_timeout: float | None = None
        self._port = port
        self._fd: int = port.fileno()
        self._arrived = b""
        self._place = 0
        self._torn = False
        os.set_blocking(self._fd, False)
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            port.close()  # before anything closes the channel that the other uses
            raise OSError(errno.EBUSY, _IN_USE) from None

    @property
    def in_waiting(self) -> int:
        """Number of bytes at hand; looks for more if there are none."""
        if self._place >= len(self._arrived):
            self._place = 0
            try:
                self._arrived = os.read(self._fd, _CHUNK_BYTES).translate(_ASCII)
            except BlockingIOError:
                self._arrived = b""
        return len(self._arrived) - self._place

    def read(self, size: int = 1) -> bytes:
        """Return the next bytes at hand, at most `size`; b"" if there are none."""
        place = self._place
        self._place = place + size
        return self._arrived[place : place + size]

    def write(self, data: bytes) -> None:
        """Send a line; one that was cut off is ended before the next, so only it is lost."""
        if self._torn:
            data = _LINE_END + data
        sent = os.write(self._fd, data)
        self._torn = sent < len(data)
        if self._torn:
            raise BlockingIOError("the port did not take all of a frame")

    def flush(self) -> None:
        """Leave it to the port when it transmits."""

    def reset_input_buffer(self) -> None:
        """Forget what has arrived."""
        self._port.reset_input_buffer()
        self._arrived, self._place = b"", 0

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._fd

    def close(self) -> None:
        """Release the port."""
        self._port.close()


def read_in_bulk(bus: can.BusABC) -> None:
    """Let an slcan bus on a serial port of this computer use a `BulkPort`; leave others alone."""
    holder: Any = bus
    if isinstance(getattr(bus, "serialPortOrig", None), serial.Serial):
        holder.serialPortOrig = BulkPort(holder.serialPortOrig)
