"""Any python-can bus as the drivers' `CanBus`."""

import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from motord.hal.can import python_can
from motord.hal.can.base import CanBus
from motord.hal.can.bus import open_bus
from motord.hal.can.python_can import PythonCan, open_python_can
from motord.wire.can.codec import EXTENDED
from tests.contract.peers import can_config

ROUNDING_NS = 1000
"""Of a time stamp that is a float of Unix seconds."""


@pytest.fixture
def pair() -> Iterator[tuple[CanBus, can.BusABC]]:
    config = can_config("virtual")
    bus = open_bus(config, "test")
    with can.Bus(config.channel, "virtual", ignore_config=True) as other:
        yield bus, other
    bus.close()


def test_frames_both_ways(pair: tuple[CanBus, can.BusABC]) -> None:
    bus, other = pair
    for key, payload in ((0x123, b"12345678"), (0x123, b"1"), (0x12345 | EXTENDED, bytes(64))):
        bus.send(key, payload)
        message = other.recv(0)
        assert message is not None
        assert (message.is_fd, message.bitrate_switch) == (True, True)
        assert message.arbitration_id == key & ~EXTENDED
        assert (bytes(message.data), message.dlc) == (payload, len(payload))
        before_ns = time.time_ns()
        other.send(message)
        after_ns = time.time_ns()
        [(heard, data, t_ns)] = bus.receive()
        assert (heard, data) == (key, payload)
        assert before_ns - ROUNDING_NS <= t_ns <= after_ns + ROUNDING_NS  # when it came
    assert bus.receive() == []
    assert bus.state.errors == 0


def test_only_what_is_listened_to(pair: tuple[CanBus, can.BusABC]) -> None:
    bus, other = pair
    mixed = [can.Message(arbitration_id=n, is_extended_id=e) for n in (5, 6) for e in (0, 1)]
    for message in mixed:
        other.send(message)
    assert len(bus.receive()) == 4
    bus.listen([5, 6 | EXTENDED])
    for message in mixed:
        other.send(message)
    other.send(can.Message(arbitration_id=5, is_extended_id=False, is_remote_frame=True))
    assert [key for key, _, _ in bus.receive()] == [5, 6 | EXTENDED]


def test_waiting_for_the_first_frame_only(pair: tuple[CanBus, can.BusABC]) -> None:
    bus, other = pair
    assert bus.receive(0.001) == []
    for _ in range(3):
        other.send(can.Message(arbitration_id=5))
    assert len(bus.receive(10.0)) == 3


def test_the_receive_buffer_is_widened_where_there_is_one() -> None:
    bus = open_python_can(can_config())
    with socket.socket(fileno=os.dup(bus._bus.fileno())) as end:
        widened = end.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    bus.close()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plain:
        asked = python_can.RECEIVE_BUFFER_BYTES
        assert widened != plain.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, asked)
        assert widened == plain.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)  # what is granted


@pytest.mark.parametrize("kind", ["a file", "closed"])
def test_a_bus_that_is_no_socket_is_left_alone(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "file"
    with path.open("w") as file:
        descriptor = file.fileno() if kind == "a file" else -1
        before = os.listdir("/proc/self/fd")  # noqa: PTH208
        python_can._widen(type("Bus", (), {"fileno": lambda _self: descriptor})())
        assert os.listdir("/proc/self/fd") == before  # noqa: PTH208
        file.write("still open")
    assert path.read_text() == "still open"


def test_both_ends_of_an_error(pair: tuple[CanBus, can.BusABC]) -> None:
    bus, other = pair
    assert isinstance(bus, PythonCan)
    other.send(can.Message(is_error_frame=True, arbitration_id=0x40, data=bytes(8)))
    other.send(can.Message(is_error_frame=True, arbitration_id=0x04, data=b"\0\x20"))
    assert bus.receive() == []
    assert (bus.state.off, bus.state.passive, bus.state.errors) == (True, True, 2)
