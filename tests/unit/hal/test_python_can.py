"""Any python-can bus as the drivers' `CanBus`."""

import time
from collections.abc import Iterator
from typing import ClassVar

import can
import pytest

from motord.hal.can import python_can
from motord.hal.can.base import CanBus
from motord.hal.can.bus import open_bus
from motord.hal.can.python_can import PythonCan
from motord.wire.can.frame_format import EXTENDED
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
        [(received_key, data, t_ns)] = bus.receive()
        assert (received_key, data) == (key, payload)
        assert before_ns - ROUNDING_NS <= t_ns <= after_ns + ROUNDING_NS  # when it came
    assert bus.receive() == []
    assert bus.state.errors == 0


@pytest.mark.parametrize("drift_s", [-0.03, 0.015])
@pytest.mark.parametrize("interface", ["kvaser", "vector", "socketcand"])
def test_stamps_of_another_clock_make_no_frame_old_or_new(
    interface: str, drift_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An adapter's clock, set by the system's once, is off by so much after minutes."""
    config = can_config("virtual")
    monkeypatch.setattr(
        python_can,
        "open_interface",
        lambda _: can.Bus(config.channel, "virtual", ignore_config=True, preserve_timestamps=True),
    )
    bus = open_bus(config.model_copy(update={"interface": interface}), "test")
    with can.Bus(config.channel, "virtual", ignore_config=True, preserve_timestamps=True) as other:
        for off_s in (0.0, drift_s):
            other.send(can.Message(arbitration_id=5, timestamp=time.time() + off_s))
        assert [t_ns for _, _, t_ns in bus.receive()] == [0, 0]
    bus.close()


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


def test_both_ends_of_an_error(pair: tuple[CanBus, can.BusABC]) -> None:
    bus, other = pair
    assert isinstance(bus, PythonCan)
    other.send(can.Message(is_error_frame=True, arbitration_id=0x40, data=bytes(8)))
    other.send(can.Message(is_error_frame=True, arbitration_id=0x04, data=b"\0\x20"))
    assert bus.receive() == []
    assert (bus.state.off, bus.state.errors) == (True, 2)


def test_a_frame_that_makes_no_sense_is_an_error_and_no_failure_of_the_bus() -> None:
    """A drive is not refused because an adapter was in the midst of a line when it was opened."""

    class Garbled(can.BusABC):
        said: ClassVar = [ValueError("no hex"), IndexError(), None]

        def __init__(self) -> None: ...

        def recv(self, timeout: float | None = None) -> None:
            if (error := self.said.pop(0)) is not None:
                raise error

        def send(self, msg: can.Message, timeout: float | None = None) -> None: ...

    bus = PythonCan(Garbled(), fd=False, system_stamped=True)
    assert bus.receive() == []
    assert (bus.state.failures, bus.state.errors) == (0, 2)
