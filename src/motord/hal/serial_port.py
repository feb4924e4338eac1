"""A serial port read in bulk and never waited for.

pyserial opens and sets up the port; after that its descriptor is read and written directly, since
pyserial's own reading costs several system calls a byte and loses data at the bridge's rates.
"""

import os
import select
import termios

import serial

from motord.hal.base import DeviceError

_CHUNK_BYTES = 1 << 16
_CHUNKS_AT_ONCE = 16
_MORE_BYTES = 2048
"""A read that gives less than this has emptied the port: terminals give 4 kB at a time."""


class SerialPort:
    """An open port in raw mode. `failures` counts reads and writes that the port refused."""

    def __init__(self, path: str, baud: int, name: str) -> None:
        """Open the port; `name` is the device that error messages name. Raises DeviceError."""
        self.failures = 0
        self._torn = False
        self._serial = serial.Serial(baudrate=baud, timeout=0, exclusive=True)
        self._serial.port = path
        try:
            self._serial.open()
            self._fd: int = self._serial.fileno()
            os.set_blocking(self._fd, False)
            termios.tcflush(self._fd, termios.TCIOFLUSH)
        except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
            self._serial.close()
            raise DeviceError(f"{name}: cannot open {path}: {_reason(error)}") from error

    def read(self) -> bytes:
        """Return all that has arrived, b"" if nothing; never waits."""
        chunks = []
        try:
            for _ in range(_CHUNKS_AT_ONCE):
                chunk = os.read(self._fd, _CHUNK_BYTES)
                if not chunk:
                    break
                chunks.append(chunk)
                if len(chunk) < _MORE_BYTES:
                    break
        except BlockingIOError:
            pass
        except OSError:
            self.failures += 1
        return chunks[0] if len(chunks) == 1 else b"".join(chunks)

    def write(self, data: bytes) -> bool:
        """Send `data`, which ends with a zero byte; False if the port did not take all of it.

        A frame that was cut off is ended by a zero before the next one, so only it is lost.
        """
        if self._torn:
            data = b"\0" + data
        try:
            sent = os.write(self._fd, data)
        except OSError:
            self.failures += 1
            return False
        self._torn = sent < len(data)
        if self._torn:
            self.failures += 1
        return not self._torn

    def wait(self, timeout_s: float) -> None:
        """Wait until something has arrived, at most `timeout_s`. For opening, not for the loop."""
        select.select([self._fd], [], [], timeout_s)

    def close(self) -> None:
        """Release the port; may be called twice."""
        self._serial.close()


def _reason(error: Exception) -> str:
    code = getattr(error, "errno", None)
    if code == 2:
        return "there is no such port; is the board plugged in, and is port right?"
    if code == 13:
        return "no permission; add the user to the group of the port (often dialout)"
    if code in (11, 16):
        return "it is in use by another program"
    return str(error)
