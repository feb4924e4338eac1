"""The firmware that goes onto the chip, run by QEMU and spoken to over its link."""

import random
import select

import numpy as np
import pytest

from motord.emulate.bridge.qemu import receive
from motord.schema import BridgeStatus
from motord.wire.bridge import frames
from tests.firmware.debugger import Debugger, arguments, hang
from tests.firmware.images import emulated
from tests.firmware.machine import FIRMWARE_TIME, machine, mutated
from tests.support.patience import PATIENCE_S

pytestmark = pytest.mark.system

TIMEOUTS_US = (1000, 10_000, 50_000, 1_000_000)
LATE_US = 1000
RECEIVING_US = 30
"""What the receive interrupt takes at most for a frame: a tick that is due meanwhile waits for it,
since both have one priority, and is stamped when it comes. The first sample's often is, since QEMU
lets bytes arrive and ticks come together; seen in 900 starts: up to 26 us."""
CLOSE = (frames.Heartbeat(0), frames.Heartbeat(1))
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
        assert [report.line_closed for report in board.reports[:1]] in ([], [False])


def test_the_image_of_the_chip_starts_and_knows_that_its_clock_and_adc_fail():
    with machine(emulated("stm32f405_in_qemu")) as board:
        hello = board.next(frames.Hello)
        assert (hello.board_name, hello.layout) == ("stm32f405", frames.LAYOUT_HASH)
        board.send(frames.Configure(1000, 1_000_000), frames.Start(), *CLOSE)
        status = board.next(frames.Status, lambda status: status.heartbeats > 1)
        failed = BridgeStatus.FAULT | BridgeStatus.TORQUE_INVALID
        assert status.status & (failed | BridgeStatus.ENABLE_LINE) == failed
        samples = [board.next(frames.Sample) for _ in range(50)]
        assert all(sample.status & BridgeStatus.FAULT for sample in samples)


def test_samples_carry_what_the_rig_feeds():
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
def test_in_the_firmwares_time_no_sample_is_missing(rate_Hz):
    with machine(emulated(), *FIRMWARE_TIME) as board:
        board.configure(2 * rate_Hz)  # every second tick is left out
        samples = [board.next(frames.Sample) for _ in range(min(rate_Hz, 1000))]
        board.send(frames.Configure(2 * rate_Hz, 100_000))
        status = board.next(frames.Status, lambda s: s.t_us > samples[-1].t_us)
    first_us, *apart_us = np.diff([sample.t_us for sample in samples])
    assert (status.dropped, status.errors, board.errors) == (0, 0, 0)
    assert -RECEIVING_US < first_us - 1e6 / rate_Hz < 20
    assert np.abs(np.subtract(apart_us, 1e6 / rate_Hz)).max() < 20


def test_a_reset_opens_the_line_and_starts_anew():
    with machine(emulated()) as board:
        board.configure(timeout_us=1_000_000)
        board.send(*CLOSE)
        board.line(closed=True)
        board.reports.clear()
        board.qemu.reset()
        board.next(frames.Hello)
        assert board.line(closed=False).t_us < 1000
        board.send(frames.Configure(1000, 100_000))
        status = board.next(frames.Status)
        assert (status.streaming, status.heartbeats) == (0, 0)
        assert not status.status & (BridgeStatus.ENABLE_LINE | BridgeStatus.HEARTBEAT_LOST)
        board.reports.clear()
        board.send(frames.Heartbeat(1), frames.Start())  # a host that has not noticed
        status = board.next(frames.Status, lambda s: s.streaming)
        assert (status.heartbeats, status.status & BridgeStatus.ENABLE_LINE) == (1, 0)
        board.send(*CLOSE)
        board.line(closed=True)


def test_hello_is_received_though_the_reset_tore_a_frame():
    with machine(emulated()) as board:
        assert select.select([board.qemu.link], (), (), PATIENCE_S)[0]
        assert receive(board.qemu.link)[:1] == b"\0"  # ends what came before


def silence(board, chance):
    """Send nothing more."""


def noise(board, chance):
    board.send(chance.randbytes(40))


def questions(board, chance):
    board.send(frames.HelloRequest(frames.PROTOCOL))


def configures(board, chance):
    board.send(frames.Configure(TICK_HZ, 50_000))


def corrupt_heartbeats(board, chance):
    board.send(mutated(frames.encode(frames.Heartbeat(1), chance.randrange(65536)), chance))


def one_heartbeat_again(board, chance):
    board.send(frames.encode(frames.Heartbeat(1), 3))


@pytest.mark.parametrize("timeout_us", TIMEOUTS_US)
def test_silence_opens_the_line_within_a_millisecond_of_the_timeout(timeout_us):
    opened_us = opening_us(timeout_us, silence)
    assert timeout_us <= opened_us <= timeout_us + LATE_US


@pytest.mark.parametrize("host", [noise, questions, corrupt_heartbeats, one_heartbeat_again])
def test_a_host_that_is_not_alive_opens_the_line_as_silence_does(host):
    opened_us = opening_us(50_000, host)
    assert 50_000 <= opened_us <= 50_000 + LATE_US


def test_a_host_that_configures_starts_and_the_line_opens_at_once():
    assert opening_us(50_000, configures) < 50_000


def close_line(board):
    """Close the line; return the report of it, and how many heartbeats the board has had.

    A busy computer may hand the two to the machine further apart than the timeout: then again.
    """

    def closed():
        return next((report for report in board.reports if report.line_closed), None)

    def taken(sent):
        had = (one.frame for one in board.frames if type(one.frame) is frames.Status)
        times_us = [status.t_us for status in had if status.heartbeats == sent]
        return times_us and any(report.t_us > times_us[0] for report in board.reports)

    sent = 0
    while closed() is None:
        board.send(*CLOSE)
        sent += len(CLOSE)
        board.wait_for(lambda sent=sent: closed() or taken(sent), "the heartbeats to be taken")
    return closed(), sent


def opening_us(timeout_us, host):
    """Return how long after the only good heartbeat the line opens, in firmware time."""
    chance = random.Random(timeout_us)
    with machine(emulated(), *FIRMWARE_TIME) as board:
        board.configure(TICK_HZ, timeout_us)
        board.reports.clear()
        closed, heartbeats = close_line(board)
        while not (
            opened := [t for t in board.reports if t.t_us > closed.t_us and not t.line_closed]
        ):
            host(board, chance)
            board.poll(0.005)
        status = board.next(frames.Status, lambda s: s.heartbeats == heartbeats)
        assert 0 <= closed.t_us - status.heartbeat_t_us < LATE_US
        return opened[0].t_us - status.heartbeat_t_us


def test_corrupt_heartbeats_are_none():
    chance = random.Random(3)
    with machine(emulated()) as board:
        board.configure(100)
        good = (frames.encode(frames.Heartbeat(1), number) for number in range(1000))
        bad = [mutated(frame, chance) for frame in good]
        board.send(b"".join(bad), frames.HelloRequest(frames.PROTOCOL), frames.Stop())
        status = board.next(frames.Status, lambda s: not s.streaming)
        assert status.heartbeats == 0
        assert not any(report.line_closed for report in board.reports)
        assert 0.9 * len(bad) < status.errors < 1.1 * len(bad)  # a zero in a frame makes two


def test_a_main_loop_that_hangs_does_not_keep_the_line_closed(tmp_path):
    with machine(emulated(), *arguments(tmp_path / "gdb")) as board:
        board.configure(timeout_us=1_000_000)
        board.send(*CLOSE)
        board.line(closed=True)
        board.reports.clear()
        hang(tmp_path / "gdb")
        board.line(closed=True)  # the interrupts go on
        opened_us = board.line(closed=False).t_us
        board.frames.clear()
        board.send(frames.HelloRequest(frames.PROTOCOL))
        board.poll(0.2)
        # what it sent before it hung may still be on its way; an answer, or a new sample, is not
        on_their_way = [one.frame for one in board.frames]
        assert all(isinstance(one, frames.Sample) for one in on_their_way)
        assert all(one.t_us < opened_us for one in on_their_way)


def test_a_fault_opens_the_line_and_starts_anew(tmp_path):
    with machine(emulated(), *arguments(tmp_path / "gdb")) as board:
        board.configure(timeout_us=1_000_000)
        board.send(*CLOSE)
        closed = board.line(closed=True)
        board.reports.clear()
        with Debugger(tmp_path / "gdb") as debugger:
            debugger.jump(0x3000_0000)
        assert board.line(closed=False).t_us < closed.t_us + 900_000
        board.next(frames.Hello)
