"""The firmware that goes onto the chip, run by QEMU and spoken to over its link."""

import random

import numpy as np
import pytest

from motord.schema import BridgeStatus
from motord.wire import frames
from tests.firmware.debugger import ENABLE_INTERRUPTS_AND_HANG, HANG_AT, Debugger, arguments
from tests.firmware.images import emulated
from tests.firmware.machine import FIRMWARE_TIME, machine, mutated

pytestmark = pytest.mark.system

TIMEOUTS_US = (1000, 10_000, 50_000, 1_000_000)
LATE_US = 1000
TICK_HZ = 4000
"""With FIRMWARE_TIME QEMU's clock jumps over every second tick: this makes 2000, the fewest that
the board ever has."""


def gray(position):
    return position ^ position >> 1


def test_the_board_says_who_it_is():
    with machine(emulated()) as board:
        hello = board.next(frames.Hello)
        assert hello.board_name == "qemu-stm32f405"
        assert (hello.protocol, hello.layout) == (frames.PROTOCOL, frames.LAYOUT_HASH)
        assert (hello.counts, hello.rate_Hz) == (4096, 1000)
        board.send(frames.HelloRequest(frames.PROTOCOL))
        assert board.next(frames.Hello) == hello
        assert [told.line_closed for told in board.told[:1]] in ([], [False])


def test_the_image_of_the_chip_starts_and_knows_that_its_clock_and_adc_fail():
    with machine(emulated("stm32f405_in_qemu")) as board:
        hello = board.next(frames.Hello)
        assert (hello.board_name, hello.layout) == ("stm32f405", frames.LAYOUT_HASH)
        board.send(frames.Configure(1000, 1_000_000), frames.Start(), frames.Heartbeat(1))
        status = board.next(frames.Status, lambda status: status.heartbeats > 0)
        assert status.status == BridgeStatus.FAULT | BridgeStatus.TORQUE_INVALID
        samples = [board.next(frames.Sample) for _ in range(50)]
        assert all(sample.status & BridgeStatus.FAULT for sample in samples)


def test_samples_tell_what_the_rig_feeds():
    with machine(emulated()) as board:
        board.configure(rate_Hz=2000)
        board.feed(gray(4000), 0)
        board.next(frames.Sample, lambda s: s.encoder_gray == gray(4000) and not s.status)
        for step in range(1, 200):
            lines, torque = gray((4000 + 7 * step) % 4096), -32_000 + 317 * step
            board.feed(lines, torque)
            sample = board.next(frames.Sample, lambda s, lines=lines: s.encoder_gray == lines)
            assert (sample.torque_counts, sample.status) == (torque, 0)


@pytest.mark.parametrize("rate_Hz", [100, 1000, 5000])
def test_samples_come_at_their_rate(rate_Hz):
    with machine(emulated(), *FIRMWARE_TIME[:1], "shift=4") as board:
        board.configure(rate_Hz)
        count = max(rate_Hz // 4, 50)
        t_us = [board.next(frames.Sample).t_us for _ in range(count)]
    assert np.median(np.diff(t_us)) == pytest.approx(1e6 / rate_Hz, rel=0.02)
    assert np.diff(t_us).min() > 0


def test_a_reset_opens_the_line_and_starts_anew():
    with machine(emulated()) as board:
        board.configure(timeout_us=1_000_000)
        board.send(frames.Heartbeat(1))
        board.line(closed=True)
        board.told.clear()
        board.qemu.reset()
        board.next(frames.Hello)
        assert board.line(closed=False).t_us < 1000
        board.send(frames.Configure(1000, 100_000))
        status = board.next(frames.Status)
        assert (status.streaming, status.heartbeats) == (0, 0)
        assert not status.status & (BridgeStatus.ENABLE_LINE | BridgeStatus.HEARTBEAT_LOST)


def silence(board, chance):
    """Send nothing more."""


def noise(board, chance):
    board.send(chance.randbytes(40))


def questions(board, chance):
    board.send(frames.HelloRequest(frames.PROTOCOL), frames.Configure(TICK_HZ, 50_000))


def corrupt_heartbeats(board, chance):
    board.send(mutated(frames.encode(frames.Heartbeat(1), chance.randrange(65536)), chance))


def one_heartbeat_again(board, chance):
    board.send(frames.encode(frames.Heartbeat(1), 2))


@pytest.mark.parametrize("timeout_us", TIMEOUTS_US)
def test_silence_opens_the_line_within_a_millisecond_of_the_timeout(timeout_us):
    opened_us = opening_us(timeout_us, silence)
    assert timeout_us <= opened_us <= timeout_us + LATE_US


@pytest.mark.parametrize("host", [noise, questions, corrupt_heartbeats, one_heartbeat_again])
def test_a_host_that_is_not_alive_opens_the_line_as_silence_does(host):
    opened_us = opening_us(50_000, host)
    assert 50_000 <= opened_us <= 50_000 + LATE_US


def opening_us(timeout_us, host):
    """Return how long after the only good heartbeat the line opens, in firmware time."""
    chance = random.Random(timeout_us)
    with machine(emulated(), *FIRMWARE_TIME) as board:
        board.configure(TICK_HZ, timeout_us)
        board.told.clear()
        board.send(frames.Heartbeat(1))
        closed = board.line(closed=True)
        while not (opened := [t for t in board.told if t.t_us > closed.t_us and not t.line_closed]):
            host(board, chance)
            board.poll(0.005)
        status = board.next(frames.Status, lambda s: s.heartbeats == 1)
        assert 0 <= closed.t_us - status.heartbeat_t_us < LATE_US
        return opened[0].t_us - status.heartbeat_t_us


def test_corrupt_heartbeats_are_none():
    chance = random.Random(3)
    with machine(emulated()) as board:
        board.configure(100)
        good = (frames.encode(frames.Heartbeat(1), number) for number in range(3000))
        bad = [mutated(frame, chance) for frame in good]
        bad = [frame for frame in bad if frames.decode(frame[:-1]) is None]
        assert len(bad) > 2900
        board.send(b"".join(bad), frames.Stop())
        status = board.next(frames.Status, lambda s: not s.streaming)
        assert status.heartbeats == 0
        assert not any(told.line_closed for told in board.told)
        assert 0.9 * len(bad) < status.errors < 1.1 * len(bad)  # a zero in a frame makes two


def test_a_main_loop_that_hangs_does_not_keep_the_line_closed(tmp_path):
    with machine(emulated(), *arguments(tmp_path / "gdb")) as board:
        board.configure(timeout_us=1_000_000)
        board.send(frames.Heartbeat(1))
        board.line(closed=True)
        board.told.clear()
        with Debugger(tmp_path / "gdb") as debugger:
            debugger.write(HANG_AT, ENABLE_INTERRUPTS_AND_HANG)
            debugger.jump(HANG_AT)
        board.line(closed=True)  # the interrupts go on
        board.line(closed=False)
        board.frames.clear()
        board.send(frames.HelloRequest(frames.PROTOCOL))
        board.poll(0.2)
        assert not board.frames


def test_a_fault_opens_the_line_and_starts_anew(tmp_path):
    with machine(emulated(), *arguments(tmp_path / "gdb")) as board:
        board.configure(timeout_us=1_000_000)
        board.send(frames.Heartbeat(1))
        closed = board.line(closed=True)
        board.told.clear()
        with Debugger(tmp_path / "gdb") as debugger:
            debugger.jump(0x3000_0000)
        assert board.line(closed=False).t_us < closed.t_us + 900_000
        board.next(frames.Hello)
