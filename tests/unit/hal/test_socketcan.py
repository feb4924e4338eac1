"""The raw socket's frames and system calls, over a pair of datagram sockets: the kernel of the
computer that runs this need not know CAN. `tests/vm` has the real thing."""

import errno
import os
import socket
import struct
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from motord.hal.base import DeviceError
from motord.hal.can import socketcan
from motord.hal.can.base import FRAMES_AT_ONCE, REFUSED_MAX
from motord.hal.can.bus import open_bus
from motord.hal.can.socketcan import BATCH, SocketCan
from motord.wire.can.frame_format import EXTENDED
from tests.contract.peers import can_config

Pair = tuple[SocketCan, socket.socket]
ERROR = 1 << 29


@pytest.fixture
def pair() -> Iterator[Pair]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    ours.setblocking(False)
    ours.setsockopt(socket.SOL_SOCKET, socketcan._SO_TIMESTAMPNS, 1)
    bus = SocketCan(ours, "can7", fd=True)
    with theirs:
        yield bus, theirs
    bus.close()


def fd_frame(key: int, payload: bytes) -> bytes:
    return struct.pack("=IBB2x", key, len(payload), 1) + payload.ljust(64, b"\0")


def classic_frame(key: int, payload: bytes) -> bytes:
    return struct.pack("=IB3x", key, len(payload)) + payload.ljust(8, b"\0")


@pytest.mark.parametrize("key", [0x7FF, 0x123 | EXTENDED])
@pytest.mark.parametrize("payload", [b"", b"1", bytes(range(8)), bytes(range(64))])
def test_frames_go_out_whole(pair: Pair, key: int, payload: bytes) -> None:
    bus, other = pair
    bus.send(0x55, bytes(range(100, 164)))
    other.recv(100)
    bus.send(key, payload)
    sent = other.recv(100)
    assert (len(sent), sent[: 8 + len(payload)]) == (72, fd_frame(key, payload)[: 8 + len(payload)])


def test_classical_frames_are_short() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    bus = SocketCan(ours, "can7", fd=False)
    with theirs:
        bus.send(0x123, b"1234567")
        assert theirs.recv(100) == classic_frame(0x123, b"1234567")
    bus.close()


def test_frames_come_in_whole_with_the_time_of_arrival(pair: Pair) -> None:
    bus, other = pair
    begun_ns = time.time_ns()
    other.send(fd_frame(0x180, bytes(range(16))))
    other.send(classic_frame(0x181 | EXTENDED, b"abc"))
    first, second = bus.receive()
    assert first[:2] == (0x180, bytes(range(16)))
    assert second[:2] == (0x181 | EXTENDED, b"abc")
    assert begun_ns <= first[2] <= second[2] <= time.time_ns()
    assert bus.receive() == []


def test_without_a_stamp_there_is_no_time() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    bus = SocketCan(ours, "can7", fd=True)
    with theirs:
        theirs.send(classic_frame(0x181, b"abc"))
        assert bus.receive() == [(0x181, b"abc", 0)]
    bus.close()


@pytest.mark.parametrize("count", [1, BATCH - 1, BATCH, BATCH + 1, 3 * BATCH])
def test_batches_join(pair: Pair, count: int) -> None:
    """Fed as the queue of a datagram socket takes it, over and over, in the same memory."""
    bus, other = pair
    other.setblocking(False)
    sent = received = 0
    while received < count:
        while sent < count:
            try:
                other.send(classic_frame(sent, bytes([sent % 256])))
            except BlockingIOError:
                break
            sent += 1
        frames = bus.receive()
        assert [f[:2] for f in frames] == [(n, bytes([n % 256])) for n in range(received, sent)]
        received += len(frames)


def test_a_flood_is_taken_in_bounded_bites(monkeypatch: pytest.MonkeyPatch, pair: Pair) -> None:
    bus, other = pair
    for _ in range(5):
        other.send(classic_frame(ERROR | 0x80, bytes(8)))
    taken: list[int] = []
    real = bus._inbox.take

    def never_ending(fd: int) -> int:
        taken.append(fd)
        return max(real(fd), BATCH)

    monkeypatch.setattr(bus._inbox, "take", never_ending)
    bus.receive()
    assert len(taken) == FRAMES_AT_ONCE // BATCH


def test_error_frames_go_to_the_state(pair: Pair) -> None:
    bus, other = pair
    other.send(classic_frame(ERROR | 0x40, bytes(8)))
    other.send(classic_frame(ERROR | 0x04, b"\0\x20"))
    assert bus.receive() == []
    assert (bus.state.off, bus.state.errors) == (True, 2)
    other.send(classic_frame(0x100, b""))
    assert len(bus.receive()) == 1
    assert (bus.state.off, bus.state.errors) == (False, 2)


def test_waiting_for_the_first_frame_only(pair: Pair) -> None:
    bus, other = pair
    assert bus.receive(0.001) == []
    other.send(classic_frame(1, b""))
    assert len(bus.receive(10.0)) == 1


def test_calls_that_fail_are_counted(pair: Pair) -> None:
    bus, other = pair
    other.close()
    for _ in range(REFUSED_MAX):
        assert not bus.state.off
        bus.send(1, b"")
    assert (bus.state.off, bus.state.failures) == (True, REFUSED_MAX)
    bus.close()
    assert bus.receive() == []
    assert bus.state.failures == REFUSED_MAX + 1
    assert bus.state.last == os.strerror(errno.EBADF)


def test_a_full_queue_is_a_refusal(pair: Pair) -> None:
    bus, _ = pair
    while not bus.state.failures:
        bus.send(1, b"12345678")
    assert not bus.state.off


def mask_of(key: int) -> int:
    return socketcan._mask(key)


def test_filters_distinguish_kinds_of_identifiers() -> None:
    for key in (0x100, 0x100 | EXTENDED):
        others = [key ^ 1, key ^ (1 << 30), key ^ EXTENDED]
        assert all((other ^ key) & mask_of(key) for other in others)


def test_socketcan_has_no_options() -> None:
    config = can_config("socketcan", channel="can0", options={"local_loopback": True})
    with pytest.raises(DeviceError, match="no options, not local_loopback"):
        open_bus(config, "test")


@pytest.mark.parametrize(("mtu", "wrong"), [(16, True), (72, False), (2060, False)])
def test_an_interface_for_classical_can_only(
    monkeypatch: pytest.MonkeyPatch, mtu: int, wrong: bool
) -> None:
    def ioctl(_end: Any, request: int, data: bytes) -> bytes:
        assert (request, data[:16], len(data)) == (0x8921, b"can7".ljust(16, b"\0"), 32)
        return data[:16] + struct.pack("i12x", mtu)

    monkeypatch.setattr(socketcan, "fcntl", SimpleNamespace(ioctl=ioctl))
    with socket.socket() as end:
        if wrong:
            with pytest.raises(OSError, match="set up for classical CAN"):
                socketcan._needs_fd(end, "can7")
        else:
            socketcan._needs_fd(end, "can7")
