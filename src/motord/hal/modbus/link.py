"""Links to Modbus devices: a TCP connection, or a serial line that several devices share.

A link makes one request at a time and waits for its response, `timeout_s` at most. A computer that
was kept from running for longer than that takes one last look at what has come meanwhile.
"""

import os
import select
import socket
import struct
import threading
import time
from typing import ClassVar

import serial

from motord.config import ModbusLinkConfig
from motord.hal.countdown import Countdown
from motord.wire.modbus.pdu import (
    TCP_HEAD,
    ModbusRequest,
    ModbusResponse,
    rtu_frame,
    rtu_response,
    tcp_frame,
)

CHUNK_BYTES = 4096
TRANSACTIONS = 1 << 16
PAUSE_CHARACTERS = 3.5
BITS_PER_CHARACTER = 11
PAUSE_LEAST_S = 0.00175
"""Silence between two frames on a serial line, as the Modbus specification has it."""
_ABORT = struct.pack("ii", 1, 0)
"""SO_LINGER with no time: what has not been delivered is thrown away."""


class TcpLink:
    """A connection of its own. Responses carry the number of their request.

    `host` is the address that was reached, which needs no name server the next time. A request
    without a response is not delivered after `close`: a set-point that arrived when the cable is
    plugged in again would be an old one.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        """Connect. Raises OSError."""
        self._timeout_s = timeout_s
        self._transaction = 0
        self._rest = b""
        self._unanswered = False
        self._socket = socket.create_connection((host, port), timeout=timeout_s)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.host: str = self._socket.getpeername()[0]

    def exchange(self, unit: int, request: ModbusRequest) -> ModbusResponse:
        """Return the response of `unit`.

        Raises TimeoutError if none comes, ValueError for one that does not fit, and OSError if
        the link is lost.
        """
        self._transaction = (self._transaction + 1) % TRANSACTIONS
        self._unanswered = True
        self._socket.sendall(tcp_frame(self._transaction, unit, request))
        countdown = Countdown(self._timeout_s)
        while True:
            transaction, responding_unit, pdu = self._frame(countdown)
            if transaction != self._transaction:
                continue
            response = request.decode(pdu)
            if response is None or responding_unit != unit:
                raise ValueError("the answer does not fit the question")
            self._unanswered = False
            return response

    def close(self) -> None:
        """Disconnect; may be called twice."""
        if self._unanswered and self._socket.fileno() >= 0:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _ABORT)
        self._socket.close()

    def _frame(self, countdown: Countdown) -> tuple[int, int, bytes]:
        """Return transaction, unit and content of the next frame."""
        self._await(TCP_HEAD.size, countdown)
        transaction, protocol, size, unit = TCP_HEAD.unpack_from(self._rest)
        if protocol != 0 or not 2 <= size <= 254:
            raise ValueError("what answers there does not speak Modbus TCP")
        end = TCP_HEAD.size - 1 + size
        self._await(end, countdown)
        pdu, self._rest = self._rest[TCP_HEAD.size : end], self._rest[end:]
        return transaction, unit, pdu

    def _await(self, size: int, countdown: Countdown) -> None:
        while len(self._rest) < size:
            if not _readable(self._socket.fileno(), countdown.left_s()):
                continue
            data = self._socket.recv(CHUNK_BYTES)
            if not data:
                raise ConnectionResetError("the device closed the connection")
            self._rest += data


class RtuLink:
    """A device's place on a serial line, which other devices of this program may share."""

    host = ""

    def __init__(self, config: ModbusLinkConfig) -> None:
        """Open the port, or join those who have. Raises OSError, ValueError."""
        self._timeout_s = config.timeout_s
        self._line: _SerialLine | None = _SerialLine.join(config)

    def exchange(self, unit: int, request: ModbusRequest) -> ModbusResponse:
        """Return the response of `unit`. Raises TimeoutError, OSError."""
        if self._line is None:
            raise ConnectionResetError("closed")
        return self._line.exchange(unit, request, self._timeout_s)

    def close(self) -> None:
        """Leave the line; the last one closes the port. May be called twice."""
        line, self._line = self._line, None
        if line is not None:
            line.leave(self._timeout_s)


class _SerialLine:
    """An open port. Frames are not numbered: `wire.modbus.pdu` says what is a response."""

    _open: ClassVar[dict[str, "_SerialLine"]] = {}
    _joining: ClassVar[threading.RLock] = threading.RLock()

    @classmethod
    def join(cls, config: ModbusLinkConfig) -> "_SerialLine":
        path = os.path.realpath(config.serial_port)
        with cls._joining:
            line = cls._open.get(path)
            if line is None:
                line = cls._open[path] = cls(path, config)
            elif line._settings != _settings(config):
                raise ValueError("another device on it has other baud, parity or stop_bits")
            line._users += 1
            line._wait_s += config.timeout_s
            return line

    def __init__(self, path: str, config: ModbusLinkConfig) -> None:
        self._path = path
        self._settings = _settings(config)
        self._users = 0
        self._wait_s = 0.0  # the sum of their timeouts
        self._pause_s = max(PAUSE_CHARACTERS * BITS_PER_CHARACTER / config.baud, PAUSE_LEAST_S)
        self._lock = threading.Lock()
        self._port = serial.Serial(
            config.serial_port,
            baudrate=config.baud,
            parity=config.parity,
            stopbits=config.stop_bits,
            timeout=0,
            exclusive=True,
        )
        self._quiet_since_s = time.monotonic()

    def exchange(self, unit: int, request: ModbusRequest, timeout_s: float) -> ModbusResponse:
        """Return the response; the request is sent within the timeouts of all, or not at all."""
        begun = Countdown(self._wait_s)
        if not self._lock.acquire(timeout=self._wait_s):
            raise TimeoutError("requests of another device on the line")
        try:
            self._await_silence(begun)
            return self._exchange(unit, request, timeout_s)
        except TimeoutError:
            raise
        except OSError:
            self._close()
            raise
        finally:
            self._lock.release()

    def leave(self, timeout_s: float) -> None:
        with self._joining:
            self._users -= 1
            self._wait_s -= timeout_s
            if self._users == 0:
                self._close()

    def _exchange(self, unit: int, request: ModbusRequest, timeout_s: float) -> ModbusResponse:
        frame = rtu_frame(unit, request)
        if os.write(self._port.fileno(), frame) < len(frame):
            raise BlockingIOError("the port did not take all of a frame")
        countdown = Countdown(timeout_s)
        received = b""
        try:
            while (response := rtu_response(received, unit, request)) is None:
                received += self._receive(countdown.left_s())
        except TimeoutError:
            raise TimeoutError(
                f"{len(received)} bytes of something else" if received else ""
            ) from None
        return response

    def _await_silence(self, countdown: Countdown) -> None:
        """Wait out the pause between frames; what comes now is no response."""
        while (left_s := self._quiet_since_s + self._pause_s - time.monotonic()) > 0:
            self._receive(min(left_s, countdown.left_s()))
        while self._receive(0.0):
            countdown.left_s()

    def _receive(self, timeout_s: float) -> bytes:
        """Return what has come within `timeout_s`, b"" if nothing. Raises OSError."""
        if not _readable(self._port.fileno(), timeout_s):
            return b""
        data = os.read(self._port.fileno(), CHUNK_BYTES)
        if not data:
            raise ConnectionResetError("the port is gone")
        self._quiet_since_s = time.monotonic()
        return data

    def _close(self) -> None:
        with self._joining:
            if self._open.get(self._path) is self:
                del self._open[self._path]
            self._port.close()


ModbusLink = TcpLink | RtuLink


def _readable(descriptor: int, timeout_s: float) -> bool:
    """Return whether something has come within `timeout_s`.

    By `poll`: `select`, which pyserial uses, too, knows no descriptor above 1023, and a daemon has
    one for each client.
    """
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(1e3 * timeout_s))


def _settings(config: ModbusLinkConfig) -> tuple[int, str, int]:
    return config.baud, config.parity, config.stop_bits


def connect(config: ModbusLinkConfig, host: str = "") -> ModbusLink:
    """Return a link to a device, at `host` if it is known. Raises OSError, ValueError."""
    if config.transport == "tcp":
        return TcpLink(host or config.host, config.tcp_port, config.timeout_s)
    return RtuLink(config)
