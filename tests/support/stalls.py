"""What a computer too busy to run a bench is forgiven: trips of staleness, proven and counted.

A test whose bench must keep running in real time tries again after such a trip, and only then: the
first cause is one of `STALENESS`, or an encoder that is not where it should be after a gap, and
since the try began the bench's processes were kept from running for at least as long as the limit
that tripped. The end of a run of tests lists them all.
"""

import os
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from motord.schema import Trip

STALENESS = (
    Trip.ENCODER_STALE | Trip.TORQUE_STALE | Trip.INVERTER_STALE | Trip.SUPERVISOR_STALE
    | Trip.LOOP_OVERRUN | Trip.LINK_ERRORS
)  # fmt: skip
LINE = ("INVERTER_FAULT", "BRIDGE_FAULT", "ENABLE_LINE")
"""What comes of heartbeats or commands that stayed away: only if the loop itself missed so long, or
what carries and judges them (a board in QEMU) was kept from running."""
STALE_S = 1.0
"""The shortest limit of a patient bench that a busy computer exceeds."""
SIGNALS = ("tick", "encoder", "torque", "inverter")
"""Of the loop, by their names among the ages of a state."""
FRESH_S = 0.1
"""A signal that is older has met a stall, at the rates of the tests' benches."""
QUARTER_TURN_S = 0.3
"""A rotor that waits for its host so long is a quarter of a turn behind where its speed would have
taken it, at the 0.8 Hz that tests on the wire do not exceed, and no jump may be larger."""
LOOK_S = 0.05
FORGIVEN: list[str] = []
"""Reported by `tests.conftest` when all tests are over."""


def waited_s() -> dict[str, float]:
    """Return for how long each thread of this process and its descendants was ready but not run."""
    waited = {}
    this = psutil.Process()
    for process in (this, *this.children(recursive=True)):
        for path in Path(f"/proc/{process.pid}/task").glob("*/schedstat"):
            try:
                waited[str(path)] = int(path.read_text().split()[1]) * 1e-9
            except OSError:
                continue
    return waited


def wait_for_ready(patience_s: float = 60.0) -> list[str]:
    """Return the threads that are ready, once each has been run, or `patience_s` is over."""
    end_s = time.monotonic() + patience_s
    ready = waiting = _ready()
    while waiting and time.monotonic() < end_s:
        time.sleep(0.01)
        now = _ready()
        waiting = {path: ran for path, ran in waiting.items() if now.get(path) == ran}
    return list(ready)


def _ready() -> dict[str, list[str]]:
    """Return of each thread that is ready or runs, but this one, for how long and how often it ran.

    Of one that runs the time grows.
    """
    ready = {}
    for process in (this := psutil.Process(), *this.children(recursive=True)):
        for thread in Path(f"/proc/{process.pid}/task").glob("*"):
            try:
                state = (thread / "stat").read_text().rpartition(") ")[2][0]
                ran_ns, _, runs = (thread / "schedstat").read_text().split()
            except OSError:
                continue
            if state == "R" and thread.name != str(threading.get_native_id()):
                ready[str(thread)] = [ran_ns, runs]
    return ready


def stolen_s() -> float:
    """Return the time that a hypervisor gave to others, the mean of this computer's processors."""
    fields = Path("/proc/stat").read_text().splitlines()[0].split()
    return int(fields[8]) / os.sysconf("SC_CLK_TCK") / (os.cpu_count() or 1)


Waits = tuple[dict[str, float], float, float]
"""For how long each thread waited, the time stolen from all, and the `StandStill.lasted_s` then."""


class StandStill:
    """How long this process has stood still as a whole since `begin`, though it was not kept ready.

    A machine that is paused keeps nobody waiting for a processor, and steals nothing: only what
    wanted to wake meanwhile shows it. So does a call that keeps all threads of this process from
    running: it is proof of a machine that stood still only together with another process that did.
    """

    def __init__(self) -> None:
        self.lasted_s = 0.0
        self._thread: threading.Thread | None = None
        self._looks = threading.Event()
        # it outlives its test: others put clocks of their own in the place of these
        self._now_s, self._sleep = time.monotonic, time.sleep

    def begin(self) -> None:
        """Look from now on; the first call counts."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._follow, name="stand-still", daemon=True)
            self._thread.start()
            self._looks.wait()

    def _follow(self) -> None:
        path = f"/proc/self/task/{threading.get_native_id()}/schedstat"
        descriptor = os.open(path, os.O_RDONLY)  # once: tests count those that are open
        self._looks.set()

        def looked_s() -> float:
            return self._now_s() - int(os.pread(descriptor, 100, 0).split()[1]) * 1e-9

        before_s = looked_s()
        while True:
            self._sleep(LOOK_S)
            now_s = looked_s()
            late_s, before_s = now_s - before_s - LOOK_S, now_s
            if late_s > FRESH_S:
                self.lasted_s += late_s


STOOD = StandStill()


@dataclass
class Stalls:
    """How long what runs here has been kept from running since this was made.

    age_s: of the oldest signal then, that of a stall which had begun before.
    """

    missed: int = 0
    rate_Hz: float = 1.0
    age_s: float = 0.0
    _waited_s: dict[str, float] = field(default_factory=waited_s)
    _stolen_s: float = field(default_factory=stolen_s)
    _stood_s: float = field(default_factory=lambda: STOOD.lasted_s)
    _ended: Waits | None = None

    def __post_init__(self) -> None:
        STOOD.begin()

    def end(self) -> None:
        """Count no further: with a process that ends, its waits are gone."""
        self._ended = self.so_far()

    def so_far(self) -> Waits:
        """Return what is counted by now."""
        return dict(self._waits_s()), self._stolen_since_s(), self._stood_until_s()

    def after(self, earlier: Waits) -> "Stalls":
        """Return these, of which no more are counted, without those of `earlier`, from `so_far`."""
        waits_s, stolen_s, stood_s = self.so_far()
        before_s, before_stolen_s, before_stood_s = earlier
        later = Stalls(self.missed, self.rate_Hz, _stood_s=before_stood_s)
        waits_s = {name: waits_s[name] - before_s.get(name, 0.0) for name in waits_s}
        later._ended = waits_s, stolen_s - before_stolen_s, stood_s
        return later

    def settle(self) -> None:
        """Count no further, and of waits that go on what they have lasted so far.

        The kernel counts a wait at its end: that is waited for, and what comes from now on is
        taken off again.
        """
        if self._ended is not None:
            return
        waits_s, stolen_s, begun_s = self._waits_s(), self._stolen_since_s(), time.monotonic()
        ready = wait_for_ready()
        passed_s, later_s = time.monotonic() - begun_s, self._waits_s()
        for path in ready:
            name = f"{path}/schedstat"
            before_s = waits_s.get(name, 0.0)
            waits_s[name] = max(before_s, later_s.get(name, 0.0) - passed_s)
        self._ended = waits_s, stolen_s, STOOD.lasted_s

    def lasted_s(self, missed: int = 0) -> float:
        """Return the longest wait of a thread, ticks missed by a loop, and time stolen, in all."""
        return max(self._waits_s().values(), default=0.0) + self._other_s(missed)

    def delay_s(self, missed: int = 0) -> float:
        """Return what may have been added to something that goes from process to process."""
        longest_s: dict[str, float] = {}
        for name, wait_s in self._waits_s().items():
            pid = name.split("/")[2]
            longest_s[pid] = max(longest_s.get(pid, 0.0), wait_s)
        return sum(longest_s.values()) + self._other_s(missed)

    def _waits_s(self) -> dict[str, float]:
        if self._ended is not None:
            return self._ended[0]
        now_s = waited_s()
        return {name: now_s[name] - self._waited_s.get(name, 0.0) for name in now_s}

    def missed_s(self, missed: int) -> float:
        """Return the time from the tick before those that the loop missed to the one after them."""
        lost = max(missed - self.missed, 0)
        return (lost + 1) / self.rate_Hz if lost else 0.0

    def stood_still(self, missed: int) -> int:
        """Return how many of the ticks that a loop missed this process stood still for, too."""
        return min(missed, round((self._stood_until_s() - self._stood_s) * self.rate_Hz))

    def _stood_until_s(self) -> float:
        return STOOD.lasted_s if self._ended is None else self._ended[2]

    def _other_s(self, missed: int) -> float:
        return self.age_s + self.missed_s(missed) + self._stolen_since_s()

    def _stolen_since_s(self) -> float:
        return stolen_s() - self._stolen_s if self._ended is None else self._ended[1]


def is_fresh(state: Any) -> bool:
    """Return whether what the loop of `state` goes by has just come: no stall is going on."""
    return _age_s(state) < FRESH_S


def of_bench(state: Any) -> Stalls:
    """Return stalls from now on, with the ticks that the loop of `state` misses."""
    return Stalls(state.loop.missed, state.loop.rate_Hz, _age_s(state))


def _age_s(state: Any) -> float:
    return max((state.ages.get(name, 0.0) for name in SIGNALS), default=0.0)


def is_explicable(cause: str) -> bool:
    """Return whether a stall can be the cause of a trip by `cause` (the name of the first one)."""
    stale = cause in Trip.__members__ and bool(Trip[cause] & STALENESS)
    return stale or cause in (*LINE, "ENCODER_IMPLAUSIBLE")


def forgive(
    where: str,
    cause: str,
    stalls: Stalls,
    limit_s: float,
    missed: int = 0,
    *,
    board_is_a_process: bool = False,
) -> None:
    """Count a trip by `cause` (the name of the first one) or a "timeout"; else AssertionError.

    `missed` is the loop's count now, `limit_s` the limit that was exceeded.
    """
    stalls.settle()
    said = f"{where}: {cause}; kept from running for {stalls.lasted_s(missed):.2f} s"
    lasted_s = stalls.lasted_s(missed)
    if cause == "ENCODER_IMPLAUSIBLE":
        limit_s = QUARTER_TURN_S
    elif cause in LINE and not board_is_a_process:
        lasted_s = stalls.missed_s(missed)
        said += f", the loop for {lasted_s:.2f} s"
    else:
        known = is_explicable(cause) or cause == "timeout"
        assert known, f"no trip that a busy computer explains: {said}"
        if board_is_a_process:  # heartbeats and samples go through all of them
            lasted_s = stalls.delay_s(missed)
            said += f", its processes one after the other for {lasted_s:.2f} s"
    assert lasted_s >= limit_s, f"no stall of {limit_s:g} s explains it: {said}"
    FORGIVEN.append(said)


def runs(pid: int) -> int:
    """Return how often a process has been run: of one that wakes at a pace, how far it is."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[2])
