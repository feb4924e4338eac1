"""The emulator's side of the firmware, with sockets in place of QEMU."""

import os
import socket
import stat
from contextlib import suppress

import pytest
import serial

from motord import config
from motord.config import ConfigError
from motord.config.faults import Fault, Timeline
from motord.emulate import EmulatorError
from motord.emulate.bench import SensorReading
from motord.emulate.bridge.feed import input_frame
from motord.emulate.bridge.firmware import (
    FEED_HZ,
    FirmwareBoard,
    FirmwareLink,
    check_fault,
    check_faults,
)
from motord.emulate.bridge.qemu import Qemu, receive, send
from motord.wire.bridge import frames
from motord.wire.bridge.stream import StreamDecoder
from tests.unit.emulate.benches import EMULATED
from tests.unit.emulate.bridge.test_feed import FirmwareReport, report_frame


class Machine:
    """Sockets, and how often it was reset."""

    def __init__(self):
        self.link, self.firmware_link = socket.socketpair()
        self.feed, self.firmware_feed = socket.socketpair()
        self.resets = 0
        self.running = True
        for end in self.ends():
            end.setblocking(False)

    def ends(self):
        return self.link, self.firmware_link, self.feed, self.firmware_feed

    def reset(self):
        self.resets += 1


@pytest.fixture
def machine():
    running = Machine()
    yield running
    for end in running.ends():
        end.close()


@pytest.fixture
def board(machine):
    return FirmwareBoard(config.load(EMULATED), machine)


@pytest.fixture
def ends(tmp_path, machine, board):
    link = FirmwareLink(tmp_path / "port", machine, board)
    with serial.Serial(str(tmp_path / "port"), timeout=60) as host:
        yield link, host
    link.close()


def sample(number):
    return frames.encode(frames.Sample(number, number, number, 0), number)


def test_bytes_pass_both_ways(ends, machine):
    link, host = ends
    host.write(frames.encode(frames.Heartbeat(1), 7))
    host.flush()
    machine.firmware_link.send(sample(0) + sample(1)[:5])
    assert list(link.receive(1)) == []
    assert receive(machine.firmware_link) == frames.encode(frames.Heartbeat(1), 7)
    machine.firmware_link.send(sample(1)[5:])
    assert list(link.receive(2)) == []
    decoder, got = StreamDecoder(), []
    while len(got) < 2:
        got += decoder.feed(os.read(host.fileno(), 4096))
    assert [numbered.sequence for numbered in got] == [0, 1]
    assert link.pty_name.startswith("/dev/pts/")
    assert link.fileno() >= 0


def test_the_enable_line_comes_from_the_firmware(ends, machine, board):
    link, _ = ends
    for closed in (True, False):
        machine.firmware_feed.send(report_frame(FirmwareReport(closed, 5)))
        list(link.receive(1))
        assert board.line_closed is closed


def test_the_rig_is_fed(ends, machine, board):
    link, _ = ends
    reading = SensorReading._make([0] * len(SensorReading._fields))
    link.sample(board, reading._replace(encoder_gray=77, torque_counts=-5), 0)
    assert receive(machine.firmware_feed) == input_frame(77, -5)


def test_the_board_itself_says_nothing(ends, machine, board):
    link, _ = ends
    assert link.send(board.hello())
    assert board.receive(0, frames.Numbered(0, frames.HelloRequest(frames.PROTOCOL))) == []
    board.expire(10**18)
    assert (board.streaming, machine.resets) == (False, 0)
    board.restart(0)
    link.greet(board)
    assert machine.resets == 2
    assert receive(machine.firmware_link) == b""


def test_faults_on_the_line(ends, machine):
    link, host = ends
    link.faults.active, link.faults.delay_ns = True, 5
    machine.firmware_link.send(sample(0))
    list(link.receive(10))
    link.faults.clear()
    link.faults.active, link.faults.off = True, True
    machine.firmware_link.send(sample(1))
    host.write(frames.encode(frames.Heartbeat(1), 0))
    host.flush()
    list(link.receive(11))
    assert receive(machine.firmware_link) == b""
    link.faults.clear()
    link.faults.active, link.faults.duplicate = True, 1.0
    link.play(15)
    machine.firmware_link.send(sample(2))
    list(link.receive(16))
    data = b""
    while data.count(0) < 3:
        data += os.read(host.fileno(), 4096)
    assert data == sample(0) + 2 * sample(2)


def test_a_machine_that_ended_ends_the_emulator(ends, machine):
    link, _ = ends
    machine.running = False
    with pytest.raises(EmulatorError, match="QEMU has ended"):
        link.receive(1)


def test_the_firmwares_clock_cannot_be_moved():
    check_fault(Fault(kind="bridge_reboot"))
    check_faults(Timeline(fault=(Fault(kind="bridge_drop"),)))
    with pytest.raises(ConfigError, match="bridge_clock: the clock of a firmware"):
        check_faults(Timeline(fault=(Fault(kind="bridge_clock"),)))


def test_an_image_that_is_not_there(tmp_path):
    with pytest.raises(EmulatorError, match=r"no such image; make -C firmware_bridge boards"):
        Qemu(tmp_path / "none.elf")


def test_without_qemu_it_says_what_to_install(tmp_path, monkeypatch):
    image = tmp_path / "image.elf"
    image.touch()
    setpriv = tmp_path / "setpriv"
    setpriv.touch()
    setpriv.chmod(stat.S_IRWXU)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(EmulatorError, match="qemu-system-arm is not installed; on Debian: apt"):
        Qemu(image)


def fake_qemu(folder, monkeypatch, script):
    """Put programs into PATH that look like the ones needed."""
    for name, text in (("setpriv", 'shift\nexec "$@"\n'), ("qemu-system-arm", script)):
        path = folder / name
        path.write_text(f"#!/bin/sh\n{text}")
        path.chmod(stat.S_IRWXU)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    image = folder / "image.elf"
    image.touch()
    return image


def test_a_machine_that_does_not_end_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr("motord.emulate.bridge.qemu.END_S", 0.05)
    qemu = Qemu(fake_qemu(tmp_path, monkeypatch, "exec sleep 100\n"))
    assert qemu.running
    qemu.reset()
    qemu.close()
    assert not qemu.running
    qemu.close()


def test_a_machine_is_ended_by_the_emulator_not_by_the_terminal(tmp_path, monkeypatch):
    sent = "kill -INT $$\nkill -HUP $$\nexit 7\n"
    qemu = Qemu(fake_qemu(tmp_path, monkeypatch, sent))
    assert qemu._process.wait() == 7
    qemu.close()


def test_a_machine_that_does_not_read_its_feed_finds_only_milliseconds_of_it(tmp_path, monkeypatch):
    """Pins have a level and no queue: what the rig was long ago must not be seen later."""
    monkeypatch.setattr("motord.emulate.bridge.qemu.END_S", 0.05)
    qemu = Qemu(fake_qemu(tmp_path, monkeypatch, "exec sleep 100\n"))
    frame, taken = input_frame(0, 0), 0
    with suppress(BlockingIOError):
        while True:
            taken += qemu.feed.send(frame)
    qemu.close()
    assert 1 <= taken // len(frame) < 0.01 * FEED_HZ


def test_a_machine_that_ends_by_itself(tmp_path, monkeypatch):
    qemu = Qemu(fake_qemu(tmp_path, monkeypatch, "exit 1\n"))
    qemu.close()
    assert not qemu.running


def test_what_finds_no_room_is_lost():
    """It is not waited for, and not raised; what found room arrives."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.setblocking(False)
        for _ in range(100_000):
            send(ours, b"12345678")
        arrived = theirs.recv(8 * 100_000)
        assert 0 < len(arrived) < 8 * 100_000
        assert arrived == b"12345678" * (len(arrived) // 8)
        theirs.close()
        send(ours, b"12345678")
