"""python-can's slcan interface over a pseudo-terminal, as the loop opens it."""

import os
import tty
from collections.abc import Iterator
from dataclasses import dataclass

import can
import pytest

from motord.hal.can.python_can import open_python_can
from motord.hal.can.slcan_port import BulkPort, read_in_bulk
from tests.contract.peers import can_config, until

LINE = b"b18081112131415161718\r"
DATA = bytes.fromhex("1112131415161718")


@dataclass
class Adapter:
    """The bus, and the descriptor of the adapter's end."""

    bus: can.BusABC
    fd: int

    def sent_by_host(self) -> bytes:
        """What the host has sent since the last call."""
        try:
            return os.read(self.fd, 65536)
        except BlockingIOError:
            return b""


@pytest.fixture
def adapter() -> Iterator[Adapter]:
    fd, host_fd = os.openpty()
    tty.setraw(host_fd)
    os.set_blocking(fd, False)
    options = {"sleep_after_open": 0.0}
    config = can_config("slcan", channel=os.ttyname(host_fd), options=options)
    bus = open_python_can(config)._bus
    made = Adapter(bus, fd)
    assert until(made.sent_by_host).startswith(b"O\r")
    yield made
    bus.shutdown()
    os.close(fd)
    os.close(host_fd)


def receive(bus: can.BusABC) -> can.Message:
    message: can.Message = until(lambda: bus.recv(0))
    return message


def frame(counter: int = 0) -> can.Message:
    return can.Message(
        arbitration_id=0x100, is_extended_id=False, is_fd=True, bitrate_switch=True,
        data=bytes([counter, 2, 3, 4]),
    )  # fmt: skip


def send_until_refused(bus: can.BusABC) -> int:
    sent = 0
    while sent < 1 << 20:
        try:
            bus.send(frame(sent % 256), timeout=0)
        except can.CanError:
            return sent
        sent += 1
    raise AssertionError("the port takes everything")


def test_frames_come_in_order_however_the_line_cuts_them(adapter: Adapter) -> None:
    os.write(adapter.fd, LINE + LINE[:7])
    first = receive(adapter.bus)
    assert (first.arbitration_id, bytes(first.data), first.is_fd) == (0x180, DATA, True)
    assert adapter.bus.recv(0) is None
    os.write(adapter.fd, LINE[7:] + LINE.replace(b"b180", b"b181"))
    assert [receive(adapter.bus).arbitration_id for _ in range(2)] == [0x180, 0x181]
    assert adapter.bus.recv(0) is None


def test_frames_go_out_at_once(adapter: Adapter) -> None:
    adapter.bus.send(frame(), timeout=0)
    assert until(adapter.sent_by_host) == b"b100400020304\r"


def test_a_frame_that_the_port_cuts_off_is_reported_and_spoils_no_other(adapter: Adapter) -> None:
    sent = send_until_refused(adapter.bus)
    received = b""

    def drain() -> bytes:
        nonlocal received
        received += adapter.sent_by_host()
        return received

    until(lambda: drain().count(b"\r") == sent)
    adapter.bus.send(frame(255), timeout=0)
    until(lambda: drain().endswith(b"b1004FF020304\r"))
    lines = received.split(b"\r")
    assert lines[:sent] == [f"b1004{n % 256:02X}020304".encode() for n in range(sent)]
    assert lines[-2:] == [b"b1004FF020304", b""]


def test_what_has_arrived_can_be_forgotten(adapter: Adapter) -> None:
    os.write(adapter.fd, LINE + LINE)
    receive(adapter.bus)
    port = adapter.bus.serialPortOrig
    assert isinstance(port, BulkPort)
    adapter.bus.flush()
    assert (port.in_waiting, adapter.bus.recv(0)) == (0, None)
    assert port.fileno() == adapter.bus.fileno()


def test_other_interfaces_are_left_alone() -> None:
    with can.Bus("left-alone", "virtual", ignore_config=True) as bus:
        before = dict(vars(bus))
        read_in_bulk(bus, {})
        assert vars(bus) == before
