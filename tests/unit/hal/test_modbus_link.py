import os
import resource
import select
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count

import pytest

from motord.config import ModbusConfig
from motord.hal.base import DeviceError
from motord.hal.modbus import link as modbus_link
from motord.hal.modbus.client import ModbusClient
from motord.hal.modbus.link import RtuLink, TcpLink, connect
from motord.wire.modbus.pdu import ModbusRequest, read, write
from tests.support.patience import PATIENCE_S


@contextmanager
def answering(answer: Callable[[bytes], bytes]) -> Iterator[int]:
    """Yield the port of a server that answers the first connection."""

    def serve() -> None:
        connection, _ = server.accept()
        with connection, suppress(ConnectionResetError):
            while request := connection.recv(300):
                connection.sendall(answer(request))

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=serve)
        thread.start()
        yield server.getsockname()[1]
        thread.join()


def ask(answer: Callable[[bytes], bytes], question: ModbusRequest, timeout_s: float = PATIENCE_S):
    with answering(answer) as port:
        link = TcpLink("127.0.0.1", port, timeout_s)
        try:
            return link.exchange(1, question)
        finally:
            link.close()
            link.close()


def test_answers_to_earlier_questions_are_passed_over() -> None:
    def answer(request: bytes) -> bytes:
        other = (int.from_bytes(request[:2], "big") - 1).to_bytes(2, "big")
        return b"".join(
            n + b"\0\0\0\5\1\3\2\0" + v for n, v in ((other, b"\7"), (request[:2], b"\x08"))
        )

    assert ask(answer, read("holding", 0, 1)) == [8]


@pytest.mark.parametrize(
    "frame",
    [b"\0\0\0\5\2\3\2\0\7", b"\0\0\0\5\1\4\2\0\7", b"\0\0\0\7\1\3\4\0\7\0\7", b"\0\0\0\2\1\3"],
    ids=["unit", "function", "registers", "cut off"],
)
def test_an_answer_that_does_not_fit(frame: bytes) -> None:
    with pytest.raises(ValueError, match="does not fit the question"):
        ask(lambda request: request[:2] + frame, read("holding", 0, 1))


@pytest.mark.parametrize(
    "greeting", [b"SSH-2.0-OpenSSH_9.2\r\n", b"\0\1\0\0\0\1\1", b"\0\1\0\0\1\1\1"]
)
def test_something_else_than_modbus(greeting: bytes) -> None:
    with pytest.raises(ValueError, match="does not speak Modbus TCP"):
        ask(lambda _: greeting, read("holding", 0, 1))


def test_half_an_answer_is_waited_for_only_so_long() -> None:
    with pytest.raises(TimeoutError):
        ask(lambda request: request[:2] + b"\0\0\0\5\1\3", read("holding", 0, 1), 0.05)


@contextmanager
def echoing_line(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Yield a serial port whose device repeats a request, before it is asked."""
    device_fd, host_fd = os.openpty()
    tty.setraw(host_fd)
    written = os.write

    def answered(port: int, data: bytes) -> int:
        written(device_fd, data)
        select.select([host_fd], [], [], PATIENCE_S)  # until it has arrived
        return written(port, data)

    with monkeypatch.context() as patched:
        patched.setattr(modbus_link.os, "write", answered)
        yield os.ttyname(host_fd)
    os.close(device_fd)
    os.close(host_fd)


@contextmanager
def busy_process() -> Iterator[None]:
    """Have so many files open that the next one has a number of 1024 or more."""
    soft, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    held = [os.open(os.devnull, os.O_RDONLY)]
    try:
        while held[-1] < 1023:
            held.append(os.open(os.devnull, os.O_RDONLY))
        yield
    finally:
        for descriptor in held:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, most))


def test_a_process_with_many_files_open_can_ask(monkeypatch: pytest.MonkeyPatch) -> None:
    """A daemon has one for each client, and may have to reach its brake anew."""
    question = write(3, [9])
    with echoing_line(monkeypatch) as port, busy_process():
        link = RtuLink(ModbusConfig(transport="rtu", serial_port=port))
        assert link.exchange(1, question) == []
        link.close()
        assert ask(lambda request: request, question) == []


def test_a_computer_that_stalls_looks_once_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time is over when the link comes to look, but the answer is there."""
    question = write(3, [9])
    with echoing_line(monkeypatch) as port:
        link = RtuLink(ModbusConfig(transport="rtu", serial_port=port, timeout_s=0.05))
        clock = count(time.monotonic() + 1.0)
        with monkeypatch.context() as patched:
            patched.setattr(modbus_link.time, "monotonic", lambda: next(clock))
            assert link.exchange(1, question) == []
    link.close()
    link.close()
    with pytest.raises(OSError, match="closed"):
        link.exchange(1, question)


def test_a_line_that_is_never_quiet() -> None:
    device_fd, host_fd = os.openpty()
    tty.setraw(host_fd)
    os.set_blocking(device_fd, False)
    link = RtuLink(ModbusConfig(transport="rtu", serial_port=os.ttyname(host_fd), timeout_s=0.1))
    stop = threading.Event()

    def babble() -> None:
        while not stop.wait(0.0005):
            try:
                os.write(device_fd, b"\x55" * 64)
            except BlockingIOError:
                continue

    thread = threading.Thread(target=babble)
    thread.start()
    with pytest.raises(TimeoutError):
        link.exchange(1, write(0, [1]))
    stop.set()
    thread.join()
    link.close()
    os.close(device_fd)
    os.close(host_fd)


def test_devices_on_one_line_must_agree_on_it() -> None:
    device_fd, host_fd = os.openpty()
    tty.setraw(host_fd)
    port = os.ttyname(host_fd)
    first = connect(ModbusConfig(transport="rtu", serial_port=port))
    with pytest.raises(ValueError, match="other baud, parity or stop_bits"):
        connect(ModbusConfig(transport="rtu", serial_port=port, baud=9600))
    first.close()
    connect(ModbusConfig(transport="rtu", serial_port=port, baud=9600)).close()
    os.close(device_fd)
    os.close(host_fd)


def test_a_port_that_is_lost_is_opened_anew_by_all() -> None:
    """Pulled out: the next question fails, and the devices on it each open it again."""
    device_fd, host_fd = os.openpty()
    tty.setraw(host_fd)
    config = ModbusConfig(transport="rtu", serial_port=os.ttyname(host_fd), timeout_s=0.05)
    first, second = connect(config), connect(config)
    os.close(host_fd)
    os.close(device_fd)
    for link in (first, second):
        with pytest.raises(OSError, match=r"."):
            link.exchange(1, write(0, [1]))
        link.close()
    assert not modbus_link._SerialLine._open


def test_a_request_without_a_response_is_thrown_away() -> None:
    """What the device has not got must not arrive when the cable is plugged in again."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = TcpLink("127.0.0.1", server.getsockname()[1], 0.05)
        device, _ = server.accept()
        with device:
            with pytest.raises(TimeoutError):
                link.exchange(1, write(0, [1500]))
            link.close()
            device.recv(300)
            with pytest.raises(ConnectionResetError):
                device.recv(300)


class NamedDevice:
    """A device at `address`, by a name whose server takes `lookup_s`; connections are noted."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.address, self.lookup_s = "192.0.2.7", 0.0
        self.hosts: list[str] = []
        self.sent = 0
        self._now_s = 0.0
        monkeypatch.setattr(modbus_link, "TcpLink", self._connected)
        monkeypatch.setattr("motord.hal.modbus.client.time.monotonic", lambda: self._now_s)

    def _connected(self, host: str, port: int, timeout_s: float) -> "NamedDevice":
        self.hosts.append(host)
        self._now_s += self.lookup_s if host == "drive.lab" else 0.0
        if host not in ("drive.lab", self.address):
            raise TimeoutError
        return self

    @property
    def host(self) -> str:
        return self.address

    def exchange(self, unit: int, request: ModbusRequest) -> list[int]:
        self.sent += 1
        raise TimeoutError

    def close(self) -> None:
        pass


def asked(client: ModbusClient, times: int) -> None:
    for _ in range(times):
        with pytest.raises(DeviceError):
            client.exchange("write", write(0, [1]))


def test_a_name_is_looked_up_once(monkeypatch: pytest.MonkeyPatch) -> None:
    device, client = NamedDevice(monkeypatch), ModbusClient(ModbusConfig(host="drive.lab"), "")
    asked(client, 3)
    assert device.hosts == ["drive.lab", "192.0.2.7", "192.0.2.7"]
    assert device.sent == 3


def test_a_name_is_looked_up_again_where_its_address_is_not_reached(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The device may have another address now."""
    device, client = NamedDevice(monkeypatch), ModbusClient(ModbusConfig(host="drive.lab"), "")
    asked(client, 1)
    device.address = "192.0.2.9"
    asked(client, 3)
    assert device.hosts == ["drive.lab", "192.0.2.7", "drive.lab", "192.0.2.9"]


def test_nothing_is_sent_after_a_slow_name_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """A set-point would be an old one; the next request needs no name server."""
    device, client = NamedDevice(monkeypatch), ModbusClient(ModbusConfig(host="drive.lab"), "")
    device.lookup_s = 5.0
    asked(client, 1)
    assert device.sent == 0
    asked(client, 1)
    assert (device.hosts, device.sent) == (["drive.lab", "192.0.2.7"], 1)


def test_a_request_that_the_line_keeps_waiting_is_not_sent() -> None:
    """Another device's requests one after the other: a set-point leaves in time or not at all."""
    device_fd, host_fd = os.openpty()
    tty.setraw(host_fd)
    os.set_blocking(device_fd, False)
    config = ModbusConfig(transport="rtu", serial_port=os.ttyname(host_fd), timeout_s=0.02)
    first, second = RtuLink(config), RtuLink(config)
    line = modbus_link._SerialLine._open[os.path.realpath(config.serial_port)]
    with line._lock, pytest.raises(TimeoutError, match="another device"):
        second.exchange(1, write(0, [1]))
    with pytest.raises(BlockingIOError):
        os.read(device_fd, 100)
    for link in (first, second):
        link.close()
    os.close(device_fd)
    os.close(host_fd)
