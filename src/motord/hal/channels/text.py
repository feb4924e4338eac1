"""Channels in lines of text from a serial port: a number where a regular expression finds one."""

import math
import re
from collections.abc import Callable

from motord.config.channel_sources import SerialSource
from motord.hal.base import DeviceError
from motord.hal.bridge.serial_port import SerialPort
from motord.hal.channel_source import RawSample
from motord.hal.countdown import countdown_s

LINE_MAX_BYTES = 4096
"""A longer line is none: its end is looked for."""
_ENDS = re.compile(rb"[\r\n]+")


class TextPort:
    """The port that several channels have, each with a look at every line."""

    def __init__(self, source: SerialSource) -> None:
        self._source = source
        self._port: SerialPort | None = None
        self._rest = b""
        self._partial = False
        self.listeners: list[Callable[[str], None]] = []

    def open(self) -> None:
        """Open it, unless it is. Raises DeviceError."""
        if self._port is None:
            path, baud = self._source.port, self._source.baud
            self._port = SerialPort(path, baud, "serial channel", "device")
            self._rest, self._partial = b"", not self._source.request

    def request(self, text: str) -> None:
        """Send a request; what has come before it is no answer."""
        port = self._opened()
        port.read()
        self._rest = b""
        port.write(text.encode())

    def wait(self, timeout_s: float) -> None:
        """Wait until something has come, at most so long. Raises DeviceError."""
        self._opened().wait(timeout_s)

    def pump(self) -> None:
        """Pass on the lines that have come. Raises DeviceError for a port that is gone."""
        port = self._opened()
        *lines, self._rest = _ENDS.split(self._rest + port.read())
        if port.failures or port.hung_up():
            self.close()
            raise DeviceError(f"{self._source.port}: the port does not answer; is it plugged in?")
        if len(self._rest) > LINE_MAX_BYTES:
            self._rest, self._partial = b"", True
        if self._partial and lines:
            self._partial = False
            del lines[0]  # it had begun before
        for line in lines:
            for listen in self.listeners:
                listen(line.decode("ascii", errors="replace"))

    def close(self) -> None:
        """Close it; may be called twice."""
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def _opened(self) -> SerialPort:
        if self._port is None:
            raise DeviceError(f"{self._source.port}: not open")
        return self._port


class TextChannel:
    """A number in lines that come by themselves, or in the answer to a request."""

    def __init__(self, source: SerialSource, port: TextPort) -> None:
        self._source = source
        self._port = port
        self._pattern = re.compile(source.pattern)
        self._group = next(iter(self._pattern.groupindex), 1)
        self._newest: RawSample | None = None
        port.listeners.append(self._look)

    def open(self) -> None:
        """Open the port, or join those who have. Raises DeviceError."""
        self._port.open()

    def read(self) -> RawSample | None:
        """Return the number in the newest line that has it. Raises DeviceError."""
        if self._source.request:
            self._ask()
        else:
            self._port.pump()
        newest, self._newest = self._newest, None
        return newest

    def close(self) -> None:
        """Close the port, of all channels that have it; each opens it again."""
        self._port.close()

    def _ask(self) -> None:
        source = self._source
        self._newest = None
        self._port.request(source.request)
        for left_s in countdown_s(source.timeout_s):
            self._port.wait(left_s)
            self._port.pump()
            if self._answered:
                return
        raise DeviceError(
            f"{source.port}: no line with {source.pattern} within {source.timeout_s:g} s "
            f"of the request {source.request!r}"
        )

    @property
    def _answered(self) -> bool:
        return self._newest is not None

    def _look(self, line: str) -> None:
        found = self._pattern.search(line)
        if found is not None:
            self._newest = RawSample(_number(found[self._group]))


def _number(text: str | None) -> float:
    """Return the number that a text is, with a point or a comma; nan if it is none."""
    try:
        return float((text or "").replace(",", "."))
    except ValueError:
        return math.nan
