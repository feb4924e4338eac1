"""A serial port read in bulk and never waited for.

pyserial opens and sets up the port; after that its descriptor is read and written directly, since
pyserial's own reading costs several system calls a byte and loses data at the bridge's rates.
A port that vanishes while it is open (its plug was pulled) is opened anew when it is back.
"""

import errno
import os
import select
import termios
import time

import serial

from motord.hal.base import DeviceError
from motord.hal.port_obstacle import port_obstacle

_CHUNK_BYTES = 1 << 16
_CHUNKS_AT_ONCE = 16
_MORE_BYTES = 2048
"""A read that gives less than this has emptied the port: terminals give 4 kB at a time."""
LOOK_AGAIN_S = 0.5
"""Between two looks if a port that vanished is back."""
_GONE = (errno.EIO, errno.ENXIO, errno.ENODEV)


class SerialPort:
    """An open port in raw mode.

    `failures` counts reads and writes that the port refused, `openings` how often it was opened.
    """

    def __init__(self, path: str, baud: int, name: str, device: str = "board") -> None:
        """Open the port of a `device`; `name` begins error messages. Raises DeviceError."""
        self.failures = self.openings = 0
        self._torn = False
        self._look_s = 0.0  # when to look for a port that vanished
        self._serial = serial.Serial(baudrate=baud, timeout=0, exclusive=True)
        self._serial.port = path
        try:
            self._fd: int | None = self._open()
        except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
            self._serial.close()
            why = port_obstacle(error, device, "port")
            raise DeviceError(f"{name}: cannot open {path}: {why}") from error

    def _open(self) -> int:
        self._serial.open()
        fd: int = self._serial.fileno()
        os.set_blocking(fd, False)
        termios.tcflush(fd, termios.TCIOFLUSH)
        self.openings += 1
        return fd

    def read(self) -> bytes:
        """Return all that has arrived, b"" if nothing; never waits."""
        fd = self._fd
        if fd is None:
            return b""
        chunks = []
        try:
            for _ in range(_CHUNKS_AT_ONCE):
                chunk = os.read(fd, _CHUNK_BYTES)
                if not chunk:
                    break
                chunks.append(chunk)
                if len(chunk) < _MORE_BYTES:
                    break
        except BlockingIOError:
            pass
        except OSError as error:
            self._fail(error)
        return chunks[0] if len(chunks) == 1 else b"".join(chunks)

    def hung_up(self) -> bool:
        """Return whether the port is gone; to a read that looks as if nothing had come."""
        if self._fd is None:
            return True
        poll = select.poll()
        poll.register(self._fd, 0)
        return bool(poll.poll(0))

    def write(self, data: bytes) -> bool:
        """Send `data`, which ends with a zero byte; False if the port did not take all of it.

        A frame that was cut off is ended by a zero before the next one, so only it is lost. While
        the port is away this looks for it now and then, which takes some system calls; `data` is
        not sent to it, as another device may be there now.
        """
        fd = self._fd
        if fd is None:
            self.failures += 1
            self._look()
            return False
        if self._torn:
            data = b"\0" + data
        try:
            sent = os.write(fd, data)
        except OSError as error:
            self._fail(error)
            return False
        self._torn = sent < len(data)
        if self._torn:
            self.failures += 1
        return not self._torn

    def wait(self, timeout_s: float) -> None:
        """Wait until something has arrived, at most `timeout_s`. For opening, not for the loop."""
        if self._fd is not None:
            select.select([self._fd], [], [], timeout_s)

    def close(self) -> None:
        """Release the port; may be called twice."""
        self._fd = None
        self._look_s = float("inf")
        self._serial.close()

    def _fail(self, error: OSError) -> None:
        """Count a refusal; give the port up if it is gone."""
        self.failures += 1
        if error.errno in _GONE and self._fd is not None:
            self._fd = None
            self._serial.close()
            self._look_s = time.monotonic() + LOOK_AGAIN_S

    def _look(self) -> None:
        """Open a port that is back, unless it was looked for a moment ago."""
        now_s = time.monotonic()
        if now_s < self._look_s:
            return
        self._look_s = now_s + LOOK_AGAIN_S
        try:
            self._fd = self._open()
        except (OSError, ValueError, termios.error):
            self._serial.close()
