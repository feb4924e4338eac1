"""A serial port under python-can's slcan interface, read in bulk and never waited for.

That interface reads byte by byte, with two system calls each, waits a millisecond when there is
nothing, and after each frame until it is transmitted. The loop can afford none of it.

An adapter that was unplugged is looked for now and then and opened anew when it is back. It is sent
bit rate and channel again until something is received from it: some take a while to listen.
"""

import errno
import fcntl
import os
import termios
import time
from collections.abc import Mapping
from io import BytesIO
from typing import Any

import serial

from motord.python_can import can

_CHUNK_BYTES = 1 << 16
_IN_USE = "another driver or program has the port open; only SocketCAN channels can be shared"
_LINE_END = b"\r"
_ASCII = bytes(range(128)) + b"?" * 128
"""slcan would never get past a byte that is no character of its lines."""
_GONE = (errno.EIO, errno.ENXIO, errno.ENODEV)
LOOK_AGAIN_S = 0.5
"""Between two looks for an adapter that is away, and two openings of its channel."""


class BulkPort:
    """What slcan uses of a `serial.Serial`, whose descriptor it takes over. Raises OSError.

    `opening`: the lines that open the adapter's channel, sent again when it was away.
    """

    def __init__(self, port: serial.Serial, opening: bytes = b"") -> None:
        """Take over an open port. Raises OSError if another driver or program did so before."""
        self.write_timeout: float | None = None
        self._port = port
        self._opening = opening
        self._arrived = b""
        self._place = 0
        self._torn = False
        self._look_s = float("inf")  # when to look for it, or to open its channel again
        try:
            self._fd: int | None = _taken(port)
        except BlockingIOError:
            port.close()  # before anything closes the channel that the other uses
            raise OSError(errno.EBUSY, _IN_USE) from None

    @property
    def in_waiting(self) -> int:
        """Number of bytes available; reads more if there are none."""
        if self._place >= len(self._arrived):
            self._place, self._arrived = 0, b""
            if self._fd is not None:
                try:
                    self._arrived = os.read(self._fd, _CHUNK_BYTES).translate(_ASCII)
                except BlockingIOError:
                    pass
                except OSError as error:
                    self._lose(error)
                    raise
            if self._arrived:
                self._look_s = float("inf")  # its channel is open
        return len(self._arrived) - self._place

    def read(self, size: int = 1) -> bytes:
        """Return the next bytes available, at most `size`; b"" if there are none."""
        place = self._place
        self._place = place + size
        return self._arrived[place : place + size]

    def write(self, data: bytes) -> None:
        """Send a line; one that was cut off is ended before the next, so only it is lost.

        While the adapter is away, or silent since, this looks for it now and then.
        """
        if time.monotonic() >= self._look_s:
            data = self._open_again() + data
        if self._fd is None:
            raise OSError(errno.ENODEV, "the adapter is away")
        if self._torn:
            data = _LINE_END + data
        try:
            sent = os.write(self._fd, data)
        except OSError as error:
            self._lose(error)
            raise
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
        """Return the descriptor, -1 while there is none."""
        return -1 if self._fd is None else self._fd

    def close(self) -> None:
        """Release the port."""
        self._fd, self._look_s = None, float("inf")
        self._port.close()

    def _lose(self, error: OSError) -> None:
        """Give the port up if it is gone."""
        if error.errno in _GONE:
            self._fd = None
            self._port.close()
            self._look_s = time.monotonic() + LOOK_AGAIN_S

    def _open_again(self) -> bytes:
        """Open a port that is back; return what opens its channel, b"" while it is away."""
        self._look_s = time.monotonic() + LOOK_AGAIN_S
        if self._fd is None:
            try:
                self._port.open()
                self._fd, self._torn = _taken(self._port), False
            except (OSError, ValueError, termios.error):  # SerialException is an OSError
                self._port.close()
                return b""
        return self._opening


def _taken(port: serial.Serial) -> int:
    """Return the descriptor of an open port, for this program alone. Raises OSError."""
    fd: int = port.fileno()
    os.set_blocking(fd, False)
    fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return fd


def read_in_bulk(bus: can.BusABC, settings: Mapping[str, object]) -> None:
    """Let an slcan bus on a serial port of this computer use a `BulkPort`; leave others alone.

    `settings`: what the bus was made with. Raises OSError.
    """
    holder: Any = bus
    port = getattr(bus, "serialPortOrig", None)
    if not isinstance(port, serial.Serial):
        return
    holder.serialPortOrig = written = BytesIO()
    if settings.get("btr") is not None:
        holder.set_bitrate_reg(settings["btr"])
    elif settings.get("bitrate") is not None:
        holder.set_bitrate(settings["bitrate"])
    else:
        holder.open()
    holder.serialPortOrig = port  # to be closed if it cannot be taken
    holder.serialPortOrig = BulkPort(port, written.getvalue())
