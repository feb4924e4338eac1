"""A CAN channel of the Linux kernel (SocketCAN), by a raw socket of our own.

All frames that have arrived come in one system call into memory made once, each with the time at
which the kernel took it from the controller; one call sends one. The kernel delivers only
the frames asked for (`listen`). A socket outlives its interface going down and up again; one
whose interface vanished (an adapter unplugged) takes it up again when it is back.
"""

import ctypes
import errno
import fcntl
import os
import select
import socket
import struct
from collections.abc import Collection, Sequence
from contextlib import suppress

from motord.hal.can.base import FRAMES_AT_ONCE, BusState, CanFrame

RECEIVE_BUFFER_BYTES = 1 << 20
"""Asked of the kernel, so that a loop that was kept waiting loses no frames; it grants at most
net.core.rmem_max."""
SEND_BUFFER_BYTES = 0
"""Of which the kernel makes its least, room for about six frames: what waits for a bus that takes
none is old by the time it goes out, so it is better refused."""
BATCH = 64
"""Frames of one system call."""

# linux/can.h, linux/can/error.h, asm-generic/socket.h
_CLASSIC_BYTES, _FD_BYTES, _HEAD_BYTES = 16, 72, 8
_EXTENDED, _REMOTE, _ERROR = 1 << 31, 1 << 30, 1 << 29
_STANDARD_MASK, _EXTENDED_MASK = 0x7FF, 0x1FFF_FFFF
_BIT_RATE_SWITCH = 0x01
_ERROR_CLASSES = 0x1FD
"""All classes of errors but lost arbitration, which is how a bus is shared, and mere counters."""
_CAN_RAW_ERR_FILTER = 2
_SO_TIMESTAMPNS = 35
_SIOCGIFMTU = 0x8921

_GONE = (errno.ENODEV, errno.ENXIO)

_HEAD = struct.Struct("=IBB")
_FILTER = struct.Struct("=II")
_ARRIVAL = struct.Struct("@IB3x64sNiill")
"""A struct canfd_frame, and behind it the control message with its struct timespec."""


class _Piece(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("size", ctypes.c_size_t))


class _Message(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_void_p),
        ("name_size", ctypes.c_uint32),
        ("pieces", ctypes.c_void_p),
        ("pieces_count", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_size", ctypes.c_size_t),
        ("flags", ctypes.c_int),
    )


class _Header(ctypes.Structure):
    _fields_ = (("message", _Message), ("received", ctypes.c_uint))


_recvmmsg = ctypes.CDLL(None, use_errno=True).recvmmsg
_recvmmsg.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)


class _Inbox:
    """Memory for a batch of frames with their stamps; how many came is what `take` returns."""

    def __init__(self) -> None:
        memory = (ctypes.c_char * (_ARRIVAL.size * BATCH))()
        self._pieces = (_Piece * BATCH)()
        self._headers = (_Header * BATCH)()
        for index, (piece, header) in enumerate(zip(self._pieces, self._headers, strict=True)):
            place = ctypes.addressof(memory) + index * _ARRIVAL.size
            piece.base, piece.size = place, _FD_BYTES
            header.message.pieces, header.message.pieces_count = ctypes.addressof(piece), 1
            header.message.control = place + _FD_BYTES
            header.message.control_size = _ARRIVAL.size - _FD_BYTES
        self.frames = memoryview(memory).cast("B")
        self._address = ctypes.addressof(self._headers)
        self._fresh = bytes(self._headers)  # the kernel writes sizes into the headers

    def take(self, fd: int) -> int:
        """Take at most `BATCH` frames without waiting. Raises OSError."""
        count: int = _recvmmsg(fd, self._address, BATCH, socket.MSG_DONTWAIT, None)
        if count < 0:
            number = ctypes.get_errno()
            if number == errno.EAGAIN:
                return 0
            raise OSError(number, os.strerror(number))
        ctypes.memmove(self._address, self._fresh, count * ctypes.sizeof(_Header))
        return count


class SocketCan:
    """A `CanBus` on a raw CAN socket, which it closes in the end."""

    def __init__(self, end: socket.socket, channel: str, fd: bool) -> None:
        self.state = BusState()
        self._socket = end
        self._channel = channel
        self._filters = _FILTER.pack(0, 0)  # everything
        self._flags = _BIT_RATE_SWITCH if fd else 0
        self._outgoing = bytearray(_FD_BYTES if fd else _CLASSIC_BYTES)
        self._inbox = _Inbox()

    def receive(self, timeout_s: float = 0.0) -> Sequence[CanFrame]:
        """Return what has arrived, the oldest first; with a timeout wait so long for the first."""
        if timeout_s:
            select.select([self._socket], [], [], timeout_s)
        received: list[CanFrame] = []
        try:
            for _ in range(FRAMES_AT_ONCE // BATCH):
                count = self._inbox.take(self._socket.fileno())
                self._sort(count, received)
                if count < BATCH:
                    break
        except OSError as error:
            self.state.failed(error.strerror)
        return received

    def send(self, key: int, payload: bytes) -> None:
        """Send a frame: CAN FD with the higher bit rate if the bus is CAN FD, else classical."""
        size = len(payload)
        _HEAD.pack_into(self._outgoing, 0, key, size, self._flags)
        self._outgoing[_HEAD_BYTES : _HEAD_BYTES + size] = payload
        try:
            self._socket.send(self._outgoing)
            self.state.sent()
        except OSError as error:
            self.state.refused(error.strerror)
            if error.errno in _GONE:
                self._bind_again()

    def listen(self, keys: Collection[int]) -> None:
        """From now on take frames with these keys only; all are taken until then."""
        self._filters = b"".join(_FILTER.pack(key, _mask(key)) for key in keys)
        self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, self._filters)

    def close(self) -> None:
        """Release the channel; may be called twice."""
        self._socket.close()

    def _bind_again(self) -> None:
        """Bind to the interface if there is one of that name; the kernel dropped the filters."""
        with suppress(OSError):
            self._socket.bind((self._channel,))
            self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, self._filters)

    def _sort(self, count: int, received: list[CanFrame]) -> None:
        """Add `count` frames of the inbox to `received`, and give error frames to the state."""
        frames = self._inbox.frames[: count * _ARRIVAL.size]
        for key, size, data, _, _, kind, seconds, ns in _ARRIVAL.iter_unpack(frames):
            if key & _ERROR:
                self.state.error_frame(key & _EXTENDED_MASK, data[1])
            else:
                self.state.received()
                stamp_ns = seconds * 1_000_000_000 + ns if kind == _SO_TIMESTAMPNS else 0
                received.append((key, data[:size], stamp_ns))


def _mask(key: int) -> int:
    """Return the bits of an identifier that must match: all, and what kind of frame it is."""
    bits = _EXTENDED_MASK if key & _EXTENDED else _STANDARD_MASK
    return bits | _EXTENDED | _REMOTE


def open_socketcan(channel: str, fd: bool) -> SocketCan:
    """Open an interface that is up; until `listen` every frame is received. Raises OSError."""
    end = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    try:
        end.setblocking(False)
        if fd:
            _needs_fd(end, channel)
            end.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        end.setsockopt(socket.SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, _ERROR_CLASSES)
        end.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        with suppress(OSError):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        end.bind((channel,))
        number = end.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if number:  # the interface is down
            raise OSError(number, os.strerror(number))
    except BaseException:
        end.close()
        raise
    return SocketCan(end, channel, fd)


def _needs_fd(end: socket.socket, channel: str) -> None:
    """Raise OSError if the interface is not for CAN FD frames."""
    request = struct.pack("16si12x", channel.encode(), 0)
    (mtu,) = struct.unpack_from("i", fcntl.ioctl(end, _SIOCGIFMTU, request), 16)
    if mtu < _FD_BYTES:
        why = f"fd = true, but it is set up for classical CAN (MTU {mtu})"
        raise OSError(errno.EMSGSIZE, why)
