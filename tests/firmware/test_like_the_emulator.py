"""The firmware answers as the emulated board does, against which motord's drivers are tested."""

import random
from collections.abc import Iterator
from typing import Any

import pytest

from motord.config import load
from motord.emulate.board import Board
from motord.schema import BridgeStatus
from motord.wire.bridge import frames
from motord.wire.bridge.segmentation import PieceDecoder
from motord.wire.bridge.stream import StreamDecoder
from tests.firmware.device import CLOCK, Device
from tests.firmware.library import Library
from tests.unit.emulate.benches import EMULATED

CONFIG = load(EMULATED)
LINKS = pytest.mark.parametrize("link", [0, 1, 2], ids=["serial", "can", "can-fd"])
WRAP_US = CLOCK - 40_000
"""Time at the start of a history, by the firmware's clock: it wraps within the first 40 ms."""
NEW_US = 10_000
"""So long after a reset the firmware may still look for the encoder and its first sample."""
NOT_SAMPLED = int(BridgeStatus.ENCODER_INVALID | BridgeStatus.TORQUE_INVALID)
CLOCKS_DIFFER = 1e-4
"""By so much at most do the two boards' clocks run apart."""

Step = tuple[Any, ...]
"""What happens, and with what: `send` a frame with its number's step, `wait` us, `reset`, or the
bytes of the frame that `lose`s its middle or end, comes `twice` or is `cut` by another one."""
ASK, CONFIGURE = frames.HelloRequest(frames.PROTOCOL), frames.Configure(1000, 5000)
STRANGER = frames.HelloRequest(frames.PROTOCOL + 1)
OPEN, CLOSE = frames.Heartbeat(0), frames.Heartbeat(1)
CLOSED: list[Step] = [("send", OPEN), ("send", CLOSE)]

HISTORIES: dict[str, list[Step]] = {
    "defaults-after-reset": [("send", frames.Start()), ("wait", 49_000), ("send", frames.Stop())],
    "default-timeout": [*CLOSED, ("wait", 49_000), ("wait", 2000), *CLOSED],
    "reset-forgets-the-configuration": [
        ("send", frames.Configure(500, 200_000)), ("send", frames.Start()), *CLOSED, ("reset",),
        ("send", CLOSE), *CLOSED, ("wait", 60_000), ("send", ASK), ("send", frames.Start()),
    ],
    "reset-forgets-numbers-and-counts": [
        ("send", OPEN, 30_000), ("twice", CLOSE), ("lose", CLOSE), ("reset",),
        ("send", OPEN, -30_000), ("send", frames.Start()), ("send", ASK),
    ],
    "barred": [
        *CLOSED, ("send", STRANGER), *CLOSED, ("send", frames.Start()), ("wait", 60_000),
        ("send", CONFIGURE), ("send", ASK), ("send", CLOSE), ("send", frames.Start()), *CLOSED,
    ],
    "barred-after-silence": [
        *CLOSED, ("wait", 60_000), ("send", STRANGER), ("send", frames.Start()), ("send", ASK),
        ("send", frames.Start()),
    ],
    "barred-until-reset": [("send", STRANGER), ("reset",), *CLOSED, ("send", frames.Start())],
    "old-frames": [
        ("send", ASK), *CLOSED, ("send", CLOSE, -2), ("send", frames.Start(), -1),
        ("send", frames.Stop(), -5), *CLOSED, ("send", OPEN, -3), ("send", ASK, -9),
        ("send", CONFIGURE, 32_767), ("send", CONFIGURE, 32_769), ("send", CLOSE, 65_535),
    ],
    "refused": [
        ("send", frames.Configure(99, 5000)), ("send", frames.Configure(20_001, 5000)),
        ("send", frames.Configure(500, 999)), ("send", frames.Configure(500, 1_000_001)),
        *CLOSED, ("send", frames.Configure(0, 0)), ("wait", 4000), ("send", CONFIGURE),
    ],
    "echoes": [("send", frames.Sample(1, 2, 3, 4)), ("send", frames.Start())],
    "torn": [
        ("lose", CONFIGURE), ("twice", frames.Start()), ("cut", frames.Stop()), ("lose", ASK),
        ("send", frames.Start()), ("twice", ASK), ("twice", CLOSE), ("send", frames.Start()),
    ],
}  # fmt: skip


class Twins:
    """Both boards, with the same bytes from the host."""

    def __init__(self, library: Library, link: int) -> None:
        self.library, self.link, self.origin_us = library, link, WRAP_US
        self.board = Board(CONFIG, reset_ns=0)
        self.reset()

    @property
    def now_ns(self) -> int:
        return (self.device.now_us - self.origin_us) * 1000

    def reset(self) -> None:
        """Reset both boards; the host knows nothing of it."""
        before = getattr(self, "device", None)
        now_us = before.now_us if before else self.origin_us
        self.device = Device(self.library, self.link, now_us)
        if before is not None:
            self.device.sequence, self.device._piece = before.sequence, before._piece
            self.board.restart(self.now_ns)
        self.born_us, self.sampled = now_us, False
        check = self.board.check
        self.decoder = PieceDecoder(check) if self.link else StreamDecoder(check)
        self.compare(self.device.answers(), [self.board.hello()])

    def do(self, what: str, *how: Any) -> None:
        if what == "reset":
            self.reset()
        elif what == "wait":
            self.let_pass(*how)
        else:
            frame, *step = how
            device = self.device
            device.sequence = (device.sequence + sum(step)) % frames.SEQUENCE_MODULUS
            wire = device.wire(frame)
            if what != "send":
                wire = getattr(self, what)(wire)
            self.receive(wire)
        self.settle()

    def lose(self, wire: list[bytes]) -> list[bytes]:
        """A byte of the serial line, the last piece on CAN."""
        return wire[:-1] if self.link else [wire[0][:4] + wire[0][5:]]

    def twice(self, wire: list[bytes]) -> list[bytes]:
        return wire + wire

    def cut(self, wire: list[bytes]) -> list[bytes]:
        return [wire[0][: len(wire[0]) // 2], *self.device.wire(OPEN)]

    def receive(self, wire: list[bytes]) -> None:
        answers: list[frames.Frame] = []
        for data in wire:
            self.device.receive(data)
            got = self.decoder.feed(data)
            for numbered in got if isinstance(got, list) else [got] if got else []:
                answers += self.board.receive(self.now_ns, numbered)
        self.compare(self.device.answers(), answers)

    def let_pass(self, time_us: int) -> None:
        """Let time pass; the emulated board samples when the firmware does."""
        for _ in range(time_us // 1000 + 1):
            self.device.pass_us(min(1000, time_us))
            for frame in self.device.answers():
                if isinstance(frame, frames.Sample):
                    age_us = (self.device.now_us - frame.t_us) % CLOCK
                    at_ns = self.now_ns - age_us * 1000
                    self.board.expire(at_ns)
                    ours = self.board.sample(at_ns, frame.encoder_gray, 0, False)
                    assert self.status(frame) == self.status(ours)
            time_us -= min(1000, time_us)

    def settle(self) -> None:
        """Judge both lines at this instant, not at the last tick, and compare all of the boards."""
        self.device.tick()
        self.device.answers()
        self.board.sample(self.now_ns, 0, 0, False)
        self.sampled = True
        self.board.expire(self.now_ns)
        assert self.device.closed == self.board.line_closed
        assert (
            self.device.lib.sequence_errors(
                self.library.ffi.addressof(self.device.bridge.receiver.check)
            )
            == self.board.errors
        )
        assert bool(self.device.bridge.streaming) == self.board.streaming

    def status(self, frame: frames.Sample | frames.Status) -> int:
        new = self.sampled and self.device.now_us - self.born_us < NEW_US
        return frame.status & ~NOT_SAMPLED if new else frame.status

    def compare(self, theirs: list[frames.Frame], ours: list[frames.Frame]) -> None:
        assert [type(answer) for answer in theirs] == [type(answer) for answer in ours]
        for their, our in zip(theirs, ours, strict=True):
            if isinstance(their, frames.Hello) and isinstance(our, frames.Hello):
                same = {"board": our.board, "serial": our.serial}
                assert their._replace(**same) == our
            elif isinstance(their, frames.Status) and isinstance(our, frames.Status):
                assert their.t_us == self.device.now_us % CLOCK
                assert our.t_us == self.board.clock_us(self.now_ns)
                same = {"t_us": our.t_us, "heartbeat_t_us": our.heartbeat_t_us}
                same |= {"status": self.status(their)}
                assert their._replace(**same) == our._replace(status=self.status(our))
                if our.heartbeats:
                    their_us, our_us = (
                        (one.t_us - one.heartbeat_t_us) % CLOCK for one in (their, our)
                    )
                    assert abs(their_us - our_us) <= 1 + CLOCKS_DIFFER * their_us
                else:
                    assert our.heartbeat_t_us == their.heartbeat_t_us


@LINKS
@pytest.mark.parametrize("history", HISTORIES.values(), ids=HISTORIES)
def test_the_same_answers_and_the_same_line(
    library: Library, link: int, history: list[Step]
) -> None:
    twins = Twins(library, link)
    for step in history:
        twins.do(*step)


def some_steps(draw: random.Random, count: int) -> Iterator[Step]:
    """Yield steps as a host may take them, and some that only a bad wire takes."""
    for _ in range(count):
        frame = draw.choice((
            OPEN, CLOSE, CLOSE, CLOSE, frames.Heartbeat(draw.choice((2, 3, 253))), ASK, STRANGER,
            frames.Configure(draw.choice((99, 100, 500, 2000, 20_000, 20_001)),
                             draw.choice((999, 1000, 7000, 50_000, 1_000_000, 1_000_001))),
            CONFIGURE, frames.Start(), frames.Stop(), frames.Hello(2, 0, b"", 0, 0, 0, 0),
        ))  # fmt: skip
        step = draw.choice((0, 0, 0, 0, 0, 1, 5, -1, -2, -10, 32_767, 32_768, 32_769))
        yield draw.choice((
            *[("send", frame, step)] * 8, *CLOSED, ("wait", draw.choice((500, 999, 1000, 6500))),
            ("wait", draw.choice((2000, 55_000))), ("twice", frame), ("lose", frame),
            ("cut", frame), *[("reset",)] * (draw.random() < 0.3),
        ))  # fmt: skip


@LINKS
@pytest.mark.parametrize("seed", range(40))
def test_the_same_after_any_history(library: Library, link: int, seed: int) -> None:
    draw = random.Random(1000 * link + seed)
    twins = Twins(library, link)
    for step in some_steps(draw, 60):
        twins.do(*step)
