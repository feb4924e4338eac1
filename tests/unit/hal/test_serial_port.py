import os
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from motord.config.channel_sources import SerialSource
from motord.hal.base import DeviceError
from motord.hal.bridge.serial_port import SerialPort
from motord.hal.channels.text import TextPort
from motord.wire.bridge import frames
from motord.wire.bridge.stream import StreamDecoder
from tests.contract.peers import until

Ends = tuple[SerialPort, int]


@pytest.fixture
def ends() -> Iterator[Ends]:
    device_fd, host_fd = os.openpty()
    tty.setraw(host_fd)
    os.set_blocking(device_fd, False)
    port = SerialPort(os.ttyname(host_fd), 2_000_000, "test")
    yield port, device_fd
    port.close()
    port.close()
    os.close(device_fd)
    os.close(host_fd)


def arrived(fd: int) -> bytes:
    """Return what has arrived: a pseudo-terminal hands on late, and in pieces."""
    try:
        return os.read(fd, 1 << 20)
    except BlockingIOError:
        return b""


def test_bytes_come_through_unchanged_both_ways(ends: Ends) -> None:
    port, device_fd = ends
    everything = bytes(range(256))
    os.write(device_fd, everything)
    received = b""
    while len(received) < len(everything):
        port.wait(1.0)
        received += port.read()
    assert received == everything
    assert port.write(everything)
    received = b""
    while len(received) < len(everything):
        received += until(lambda: arrived(device_fd))
    assert received == everything


def test_reading_nothing_is_no_failure(ends: Ends) -> None:
    port, _ = ends
    assert port.read() == b""
    assert port.failures == 0


def test_a_large_backlog_is_read_whole(ends: Ends) -> None:
    port, device_fd = ends
    sent = received = 0
    try:
        while sent < 1 << 20:
            sent += os.write(device_fd, b"x" * 4096)
    except BlockingIOError:
        pass
    while received < sent:
        port.wait(1.0)
        received += len(port.read())
    assert received == sent


def test_a_frame_cut_off_by_a_full_port_costs_no_other(ends: Ends) -> None:
    port, device_fd = ends
    number = 0
    while port.write(frames.encode(frames.Heartbeat(1), number)):
        number += 1
    assert port.failures == 1
    decoder, received = StreamDecoder(), []

    def read() -> list[frames.Numbered]:
        received.extend(decoder.feed(arrived(device_fd)))
        return received

    until(lambda: read() and port.write(frames.encode(frames.Start(), number + 1)))
    until(lambda: read()[-1].sequence > number)
    assert received[-1] == (number + 1, frames.Start())
    assert [n for n, _ in received[:-1]] == list(range(number))
    assert decoder.errors == 1


def test_a_port_that_fails_counts(monkeypatch: pytest.MonkeyPatch, ends: Ends) -> None:
    port, _ = ends

    def fail(*_: object) -> int:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patched:
        patched.setattr("motord.hal.bridge.serial_port.os.read", fail)
        patched.setattr("motord.hal.bridge.serial_port.os.write", fail)
        assert port.read() == b""
        assert not port.write(b"x\0")
    assert port.failures == 2


def plug_in(path: Path) -> int:
    """Put a new pseudo-terminal at `path`; return the device's end."""
    device_fd, host_fd = os.openpty()
    tty.setraw(host_fd)
    path.symlink_to(os.ttyname(host_fd))
    os.close(host_fd)
    return device_fd


def test_a_port_whose_plug_is_pulled_is_taken_up_again_when_it_is_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = 1000.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    path = tmp_path / "port"
    device_fd = plug_in(path)
    port = SerialPort(str(path), 2_000_000, "test")
    os.close(device_fd)
    path.unlink()
    assert not port.write(b"a\0")
    assert not port.write(b"a\0")
    assert port.read() == b""
    port.wait(1.0)
    assert port.failures == 2

    now_s += 0.6
    assert not port.write(b"b\0"), "it is still away"
    device_fd = plug_in(path)
    assert not port.write(b"b\0"), "looked for a moment ago"
    now_s += 0.6
    assert port.openings == 1
    assert not port.write(b"b\0"), "another device may be there now"
    assert port.openings == 2
    assert port.write(b"c\0")
    assert os.read(device_fd, 16) == b"c\0"
    os.write(device_fd, b"d")
    while not (received := port.read()):
        port.wait(1.0)
    assert received == b"d"
    assert port.failures == 5
    port.close()
    now_s += 10.0
    assert not port.write(b"e\0"), "closed is closed"
    os.close(device_fd)


def test_a_missing_port_of_a_channel_is_not_said_to_be_the_boards() -> None:
    port = TextPort(SerialSource(driver="serial", port="/dev/nothing", pattern=r"(\d+)"))
    with pytest.raises(DeviceError, match="is the device plugged in, and is port right"):
        port.open()
