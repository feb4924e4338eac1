"""`SocketCan` on the kernel: frames, filters, errors, stamps, what cannot be opened."""

import select
import socket
import struct
import time
from collections.abc import Iterator

import can
import pytest

from motord.hal.base import DeviceError
from motord.hal.can.bus import open_bus
from motord.hal.can.socketcan import SocketCan, open_socketcan
from motord.wire.can.frame_format import EXTENDED
from tests.contract.peers import SOCKETCAN, can_config
from tests.vm.inner import interface

LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
ERROR = 1 << 29
BUS_OFF, RESTARTED, CONTROLLER, LOST_ARBITRATION = 0x40, 0x100, 0x04, 0x02
PASSIVE = b"\0\x20".ljust(8, b"\0")
FLOOD = 20_000


@pytest.fixture
def bus() -> Iterator[SocketCan]:
    opened = open_socketcan(SOCKETCAN, fd=True)
    yield opened
    opened.close()


@pytest.fixture
def other() -> Iterator[can.BusABC]:
    with can.Bus(SOCKETCAN, "socketcan", fd=True, ignore_config=True) as opened:
        yield opened


@pytest.fixture
def raw() -> Iterator[socket.socket]:
    """A socket that sends what nobody but a controller should."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as opened:
        opened.bind((SOCKETCAN,))
        yield opened


def message(key: int, data: bytes = b"", **how: bool) -> can.Message:
    return can.Message(
        arbitration_id=key & ~EXTENDED, is_extended_id=key >= EXTENDED, data=data, **how
    )


def readable(bus: SocketCan, timeout_s: float = 0.0) -> bool:
    return bool(select.select([bus._socket], [], [], timeout_s)[0])


@pytest.mark.parametrize("key", [0, 0x7FF, EXTENDED, 0x1FFFFFFF | EXTENDED])
def test_frames_of_every_length_both_ways(bus: SocketCan, other: can.BusABC, key: int) -> None:
    for length in LENGTHS:
        data = bytes(range(length))
        bus.send(key, data)
        received = other.recv(10.0)
        assert received is not None
        assert (received.arbitration_id | EXTENDED * received.is_extended_id, received.data) == (
            key,
            data,
        )
        assert (received.is_fd, received.bitrate_switch) == (True, True)
        for fd in (True, False) if length <= 8 else (True,):
            other.send(message(key, data, is_fd=fd))
            assert [frame[:2] for frame in bus.receive(10.0)] == [(key, data)]
    assert bus.state.errors == 0


def test_classical_frames(other: can.BusABC) -> None:
    bus = open_socketcan(SOCKETCAN, fd=False)
    bus.send(0x123, b"1234567")
    received = other.recv(10.0)
    assert received is not None
    assert (received.is_fd, received.data) == (False, b"1234567")
    other.send(message(0x124, b"12345678", is_fd=True))
    other.send(message(0x125, b"123"))
    assert [frame[:2] for frame in bus.receive(10.0)] == [(0x125, b"123")]
    bus.close()


def test_frames_not_asked_for_stay_in_the_kernel(bus: SocketCan, other: can.BusABC) -> None:
    bus.listen({0x180, 0x181 | EXTENDED})
    for key in (0x181, 0x180 | EXTENDED, 0x182, 0x280):
        other.send(message(key, is_fd=True))
    other.send(message(0x180, is_remote_frame=True))
    assert not readable(bus)
    other.send(message(0x181 | EXTENDED, b"1"))
    other.send(message(0x180, b"2"))
    assert [frame[:2] for frame in bus.receive(10.0)] == [(0x181 | EXTENDED, b"1"), (0x180, b"2")]


def test_our_own_frames_are_not_received_but_by_others_on_this_computer(
    bus: SocketCan, other: can.BusABC
) -> None:
    neighbour = open_socketcan(SOCKETCAN, fd=True)
    bus.send(0x100, b"1")
    assert [frame[:2] for frame in neighbour.receive(10.0)] == [(0x100, b"1")]
    assert not readable(bus)
    neighbour.close()


def test_error_frames_report_the_controllers_state(bus: SocketCan, raw: socket.socket) -> None:
    bus.listen({0x180})

    def report(classes: int, data: bytes = bytes(8)) -> tuple[bool, int]:
        raw.send(struct.pack("=IB3x", ERROR | classes, 8) + data)
        readable(bus, 10.0)
        assert bus.receive() == []
        return bus.state.off, bus.state.errors

    assert report(CONTROLLER, PASSIVE) == (False, 1)
    assert report(BUS_OFF) == (True, 2)
    assert report(RESTARTED) == (False, 3)
    raw.send(struct.pack("=IB3x", ERROR | LOST_ARBITRATION, 8) + bytes(8))
    assert not readable(bus)
    assert report(BUS_OFF) == (True, 4)
    raw.send(struct.pack("=IB3x", 0x180, 1) + b"1".ljust(8, b"\0"))
    assert len(bus.receive(10.0)) == 1
    assert not bus.state.off


def test_stamps_are_of_the_arrival_not_of_the_reading(bus: SocketCan, other: can.BusABC) -> None:
    for _ in range(50):
        before_ns = time.time_ns()
        other.send(message(0x180, b"1"))
        assert readable(bus, 10.0)
        after_ns = time.time_ns()
        [(_, _, t_ns)] = bus.receive()
        assert before_ns <= t_ns <= after_ns


def test_a_flood_comes_in_order_and_in_bites(bus: SocketCan, other: can.BusABC) -> None:
    bus.listen({0x180})
    for number in range(FLOOD):
        other.send(message(0x180, number.to_bytes(4, "big")))
    numbers: list[int] = []
    while frames := bus.receive():
        assert len(frames) <= 1024
        numbers += [int.from_bytes(data, "big") for _, data, _ in frames]
    assert numbers == list(range(len(numbers)))
    assert 64 < len(numbers) < FLOOD, "the kernel keeps a bounded number"


def test_few_frames_wait_for_a_bus_that_takes_none(bus: SocketCan) -> None:
    size = bus._socket.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)
    assert 0 < size < 10_000, "a frame takes 768 bytes or more"


def why_not(**changes: object) -> str:
    with pytest.raises(DeviceError) as caught:
        open_bus(can_config("socketcan", **changes), "drive")
    return str(caught.value)


def test_what_cannot_be_opened() -> None:
    missing = why_not(channel="can7")
    assert missing.startswith("drive: cannot open the bus: No such device; bring it up: ip link")
    interface.down()
    assert "Network is down; bring it up" in why_not()
    interface.remove()
    interface.make(interface.CLASSIC_MTU)
    try:
        assert "fd = true, but it is set up for classical CAN (MTU 16)" in why_not()
        open_bus(can_config("socketcan", fd=False), "drive").close()
    finally:
        interface.remove()
        interface.make()
    open_bus(can_config("socketcan"), "drive").close()
