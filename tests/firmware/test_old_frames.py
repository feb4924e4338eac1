"""Whatever was sent before, in whatever order, pace and number, keeps no enable line closed.

A host lives through some sessions of its own, then falls silent. From then on the boards (firmware
and emulated) receive nothing but frames that they, or the wire, received before: single ones, runs
of them, whole sessions from their HelloRequest on, after waits of up to some seconds.
"""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.config import load
from motord.emulate.board import Board
from motord.wire.bridge import frames
from tests.firmware.device import Device
from tests.firmware.library import Library
from tests.support.properties import examples
from tests.unit.emulate.benches import EMULATED

CONFIG = load(EMULATED)
LATE_US = 1000
TIMEOUTS_US = st.sampled_from([1000, 5000, 50_000, 200_000, 1_000_000]) | st.integers(
    1000, 1_000_000
)


class Host:
    """A host that numbers its frames as motord's driver does; `sent` is all that it ever said."""

    def __init__(self, library: Library, link: int) -> None:
        self.device = Device(library, link)
        self.board = Board(CONFIG, reset_ns=0)
        self.sent: list[frames.Numbered] = []
        self.number = 0
        self.timeout_us = 50_000

    def receive(self, numbered: frames.Numbered) -> None:
        """Let both boards receive a frame."""
        now_ns = self.device.now_us * 1000
        self.device.send(numbered.frame, numbered.sequence)
        self.board.expire(now_ns)
        self.board.receive(now_ns, numbered)
        self.agree()

    def agree(self) -> None:
        assert self.device.closed == self.board.line_closed

    def say(self, frame: frames.Frame) -> None:
        self.sent.append(frames.Numbered(self.number % frames.SEQUENCE_MODULUS, frame))
        self.number = (self.number + 1) % frames.HEARTBEAT_NUMBERS
        self.receive(self.sent[-1])

    def beat(self, enable: int) -> None:
        self.say(frames.Heartbeat.of(self.number, enable=enable == 1))

    def pass_us(self, time_us: int) -> None:
        self.device.pass_us(time_us)
        self.device.tick()
        self.device.answers()
        self.board.expire(self.device.now_us * 1000)
        self.agree()

    def live(self, timeout_us: int, beats: int, closed_at_end: bool) -> None:
        """Be a daemon from its start on: hello, configuration, heartbeats."""
        self.say(frames.HelloRequest(frames.PROTOCOL))
        hello = self.board.hello()
        assert hello.heartbeat_next == self.device.bridge.heartbeat_next
        self.number, self.timeout_us = hello.heartbeat_next, timeout_us
        self.say(frames.Configure(1000, timeout_us))
        self.say(frames.Start())
        for number in range(beats):
            self.beat(int(number > 1 and (closed_at_end or number % 7 != 6)))
            if number < beats - 1:
                self.pass_us(timeout_us // 3)
        if closed_at_end:
            assert self.device.closed


def attack(host: Host, draw: random.Random, steps: int) -> None:
    """Replay what was said, without end; the line has to open in time and to stay so."""
    died_us = host.device.now_us
    heartbeats = host.board.status(0).heartbeats
    waits_us = (0, 100, host.timeout_us // 3, host.timeout_us, 1_100_000)
    starts = [n for n, one in enumerate(host.sent) if type(one.frame) is frames.HelloRequest]
    for _ in range(steps):
        first = draw.choice([*starts, draw.randrange(len(host.sent))])
        run = host.sent[first : first + draw.choice([1, 1, 2, 5, 30])]
        if draw.random() < 0.2:
            draw.shuffle(run)
        wait_us = draw.choice(waits_us)
        for numbered in run:
            host.receive(numbered)
            late_us = host.device.now_us - died_us - host.timeout_us
            assert not host.device.closed or late_us < LATE_US
            host.pass_us(wait_us)
            assert not host.device.closed or late_us + wait_us < LATE_US
    assert host.board.status(0).heartbeats == heartbeats, "an old heartbeat was taken"


@pytest.mark.parametrize("link", [0, 1], ids=["serial", "can"])
@given(
    sessions=st.lists(st.tuples(TIMEOUTS_US, st.integers(3, 40)), min_size=1, max_size=3),
    begin=st.sampled_from([0, 1000, 65_500, 32_768, (1 << 22) - 20, (1 << 23) - 20]),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=examples(150), deadline=None)
def test_no_old_frames_keep_or_get_the_line_closed(
    library: Library, link: int, sessions: list[tuple[int, int]], begin: int, seed: int
) -> None:
    host, draw = Host(library, link), random.Random(seed)
    host.number = begin
    host.beat(0)
    for number, (timeout_us, beats) in enumerate(sessions):
        host.live(timeout_us, beats, closed_at_end=number == len(sessions) - 1)
    attack(host, draw, steps=12)
    host.live(50_000, 5, closed_at_end=True)  # the living host comes back and is taken


@pytest.mark.parametrize("timeout_us", [1000, 50_000, 1_000_000])
@pytest.mark.parametrize("link", [0, 1], ids=["serial", "can"])
def test_one_heartbeat_repeated_slowly(library: Library, link: int, timeout_us: int) -> None:
    """After a second without a frame an old number is as old as before."""
    host = Host(library, link)
    host.live(timeout_us, 5, closed_at_end=True)
    died_us = host.device.now_us
    for _ in range(4):
        host.pass_us(1_200_000)
        assert not host.device.closed
        host.receive(host.sent[-1])
        host.receive(host.sent[-2])
        assert not host.device.closed
    assert host.device.now_us - died_us == 4 * 1_200_000
