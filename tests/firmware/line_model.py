"""What the enable line must do, specified a second time and in another way; and a check against it.

The model keeps no states but facts (docs/protocols.md, item 5): when the line was last asked to be
open, and what stands in the way of closing it.
"""

import random
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

CLOCK = 1 << 32
TIMEOUT_US = 1000
EVENTS = ("beat 0", "beat 1", "stop", "judge", "bar", "permit")
WAITS_US = (0, 1, TIMEOUT_US - 1, TIMEOUT_US, TIMEOUT_US + 1)
LOST_STATE = 3


@dataclass
class LineModel:
    """`alive`: time of the newest heartbeat since one that asked for an open line, without a reset,
    a Stop, a silence or a bar in between; `lost`: the host fell silent.
    """

    timeout_us: int
    alive: int | None = None
    wanted: bool = False
    lost: bool = False
    barred: bool = False

    def event(self, kind: str, now_us: int) -> None:
        """Take an event of EVENTS at a time that does not wrap."""
        judges = kind in ("beat 0", "beat 1", "stop", "judge")
        if judges and self.alive is not None and now_us - self.alive >= self.timeout_us:
            self.alive, self.lost = None, True
        if kind == "permit":
            self.barred = False
        elif kind == "bar":
            self.barred, self.lost, self.alive = True, False, None
        elif kind == "stop":
            self.alive = None
        elif kind.startswith("beat") and not self.barred:
            self.wanted = kind == "beat 1"
            if not self.wanted or self.alive is not None:
                self.alive, self.lost = now_us, False

    @property
    def closed(self) -> bool:
        return self.wanted and self.alive is not None


def play(ffi: Any, lib: Any, start_us: int, steps: Iterable[tuple[str, int]]) -> str | None:
    """Let the C machine and the model do the same; return where they differ."""
    line = ffi.new("struct enable_line *", [77, 77, 77])
    lib.enable_line_init(line, TIMEOUT_US)
    model, now_us, history = LineModel(TIMEOUT_US), start_us, []
    if lib.enable_line_closed(line) or line.timeout_us != TIMEOUT_US:
        return "does not start open"
    for kind, wait_us in steps:
        now_us += wait_us
        history.append(f"+{wait_us} us {kind}")
        _do(lib, line, kind, now_us % CLOCK)
        model.event(kind, now_us)
        if bool(lib.enable_line_closed(line)) != model.closed:
            return ", ".join(history) + f": closed is not {model.closed}"
        if (line.state == LOST_STATE) != model.lost:
            return ", ".join(history) + f": lost is not {model.lost}"
    return None


def _do(lib: Any, line: Any, kind: str, t_us: int) -> None:
    if kind.startswith("beat"):
        lib.enable_line_heartbeat(line, t_us, kind == "beat 1")
    elif kind == "stop":
        lib.enable_line_stop(line, t_us)
    elif kind == "judge":
        lib.enable_line_judge(line, t_us)
    elif kind == "bar":
        lib.enable_line_bar(line)
    else:
        lib.enable_line_permit(line)


def all_short(length: int) -> Iterator[tuple[tuple[str, int], ...]]:
    """Yield every sequence of `length` events, each after every wait."""
    return product(tuple(product(EVENTS, WAITS_US)), repeat=length)


def some_long(seed: int, count: int, length: int = 12) -> Iterator[list[tuple[str, int]]]:
    """Yield `count` random sequences; heartbeats are the most frequent."""
    draw = random.Random(seed)
    for _ in range(count):
        yield [
            (draw.choice((*EVENTS, "beat 1", "beat 1", "beat 0")), draw.choice(WAITS_US))
            for _ in range(length)
        ]


def check(ffi: Any, lib: Any, exhaustive: int = 2, random_count: int = 2000) -> str | None:
    """Compare machine and model; return the first difference found."""
    starts_us = (0, CLOCK - TIMEOUT_US, CLOCK // 2)
    for start_us in starts_us:
        for steps in all_short(exhaustive):
            if found := play(ffi, lib, start_us, steps):
                return found
    for number, steps in enumerate(some_long(1, random_count)):
        if found := play(ffi, lib, starts_us[number % 3] + number, steps):
            return found
    return None
