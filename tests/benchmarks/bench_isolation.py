"""What goes wrong around a running bench, and what the loop feels of it.

The daemon runs the simulated bench and records it, with the loop on one processor. Slices of a
tenth of a second in which all is well alternate, some at a time, with slices in which something is
not; figures are ratios of the medians over the slices from which the host stole no time. The loop's
own histograms are read, so that measuring costs it nothing.

The supervisor's heartbeat is looked at meanwhile, every few milliseconds from another process: it
must not be held up by what its other threads and processes wait for.

Wake-up is good to some 30 ns, the time of a look at the clock, and on a quiet machine little more
than that: what is below a microsecond counts as one, or the ratio would be one of clock readings.
"""

import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from motord import config
from motord.control.types import SETPOINT
from motord.loop.latency.measurement import MeasuredSlices, choose_cpu, median_of_slices_us
from motord.loop.steal_time import stolen_ticks
from motord.shm.histogram import TimeHistogram
from motord.shm.mailbox import MailboxReader
from motord.shm.run_directory import RunDir
from motord.shm.timing import Timing
from tests.benchmarks.figure import Figure, number
from tests.system.daemons import Daemon, daemon, wait_for, wait_until, write_sim
from tests.system.disturbances import (
    hogs,
    let_files_grow_no_more,
    signal_all,
    subscriber,
    unsent_bytes,
)

RATE_Hz = 2000
SLICE_S, LOOK_S = 0.1, 0.005
ACCOUNT_S = 0.02
"""Time until stolen time is in the counter."""
SLICES_A_TURN = 8
ENOUGH_CLEAN = 64
SECONDS, QUICK_S = 45.0, 4.0
RATIO_LIMIT = 2.0
FULL_BYTES = 100_000
"""Telemetry that a subscriber has not read: far more than it has room for."""
FLOOR_us = 1.0
HEARTBEAT_LIMIT_ms = 1e3 * config.load().loop.supervisor_timeout_s


@dataclass(frozen=True)
class Disturbance:
    """What goes wrong: `begin` and `end` return when it has begun, and when all is well again."""

    name: str
    begin: Callable[[], object]
    end: Callable[[], object]


@dataclass
class Seen:
    """Slices of the loop, and how old the heartbeat was at each look in the clean ones, ms."""

    loop: MeasuredSlices = field(default_factory=MeasuredSlices)
    heartbeat_ms: list[float] = field(default_factory=list)


class Bench:
    """A running daemon, the processor of its loop, what the loop counts, the mailbox."""

    def __init__(self, running: Daemon, cpu: int) -> None:
        self.daemon = running
        self.endpoint: str = running.endpoint
        self.name: str = running.config.bench.name
        self._cpu = cpu
        run_dir = RunDir(self.name, running.folder / "motord")
        self._live = Timing.attach(run_dir.timing)
        self._mailbox = MailboxReader(run_dir.setpoint)
        self._setpoint = np.zeros(1, SETPOINT)

    def heartbeat_ms(self) -> float:
        """Return how old the supervisor's heartbeat is."""
        self._mailbox.read(self._setpoint)
        return (self._mailbox.clock.now_ns() - int(self._setpoint["heartbeat_ns"][0])) / 1e6

    def take(self, seen: Seen) -> None:
        """Let a slice pass and keep what the loop counted in it."""
        stolen, before = stolen_ticks(self._cpu), self._live.copy()
        end_s, ages_ms = time.monotonic() + SLICE_S, []
        while time.monotonic() < end_s:
            time.sleep(LOOK_S)
            ages_ms.append(self.heartbeat_ms())
        part = self._live.copy().since(before)
        time.sleep(ACCOUNT_S)
        clean = stolen_ticks(self._cpu) == stolen
        (seen.loop.clean if clean else seen.loop.stolen).append(part)
        if clean:
            seen.heartbeat_ms += ages_ms

    def compare(self, disturbance: Disturbance, seconds: float) -> tuple[Seen, Seen]:
        """Return the slices without and with the disturbance, taken in turns."""
        quiet, disturbed = Seen(), Seen()
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            for _ in range(SLICES_A_TURN):
                self.take(quiet)
            disturbance.begin()
            for _ in range(SLICES_A_TURN):
                self.take(disturbed)
            disturbance.end()
            if min(len(seen.loop.clean) for seen in (quiet, disturbed)) >= ENOUGH_CLEAN:
                break
        return quiet, disturbed


@contextmanager
def running_bench(rate_Hz: int = RATE_Hz, tick_rate_Hz: float = 1000.0) -> Iterator[Bench]:
    """Run the simulated bench at `rate_Hz` with its loop on the last processor."""
    cpu = choose_cpu(config.load().loop).cpu
    assert cpu is not None
    with tempfile.TemporaryDirectory() as name:
        path = write_sim(Path(name), "isolation")
        text = path.read_text().replace("rate_Hz = 500", f"rate_Hz = {rate_Hz}\ncpu = {cpu}")
        text = text.replace("[zenoh]\n", f"[zenoh]\ntick_rate_Hz = {tick_rate_Hz}\n")
        path.write_text(f'{text}\n[recording]\nauto = "always"\n')
        with daemon(Path(name), path) as running:
            yield Bench(running, cpu)


@contextmanager
def disturbances(bench: Bench) -> Iterator[list[Disturbance]]:
    """Yield what may go wrong, all of it off."""
    with (
        bench.daemon.connect() as client,
        subscriber(bench.name, bench.endpoint) as other,
        hogs() as busy,
    ):
        signal_all(busy, signal.SIGSTOP)
        wait_for(client, lambda s: s.recording.recording, "a recording")

        def stop_subscriber() -> None:
            other.send_signal(signal.SIGSTOP)
            wait_until(lambda: unsent_bytes(bench.endpoint) > FULL_BYTES, "the link to be full")

        def resume_subscriber() -> None:
            other.send_signal(signal.SIGCONT)
            wait_until(lambda: unsent_bytes(bench.endpoint) == 0, "the link to be empty")

        def recorder() -> int:
            pid = client.state().processes["recorder"].pid
            assert pid is not None
            return int(pid)

        def kill_recorder() -> None:
            os.kill(recorder(), signal.SIGKILL)

        def fill_disk() -> None:
            let_files_grow_no_more(recorder(), 1000)
            wait_for(client, lambda s: s.recording.error, "the recording to end")

        def another_recorder() -> None:
            kill_recorder()
            await_recording()

        def await_recording() -> None:
            wait_for(client, lambda s: s.recording.recording, "a recording")

        yield [
            Disturbance("a subscriber that stands still", stop_subscriber, resume_subscriber),
            Disturbance("a killed recorder", kill_recorder, await_recording),
            Disturbance("a full disk", fill_disk, another_recorder),
            Disturbance(
                "hogs on every processor",
                lambda: signal_all(busy, signal.SIGCONT),
                lambda: signal_all(busy, signal.SIGSTOP),
            ),
        ]


def has_rights(bench: Bench) -> bool:
    """Return whether the loop has real-time priority."""
    with bench.daemon.connect() as client:
        lines = client.state().realtime.get("lines", [])
    return any(line.startswith("scheduler: SCHED_FIFO") for line in lines)


def figures(quick: bool) -> list[Figure]:
    """Return p99 of wake-up and work with each disturbance to those without; the heartbeat."""
    found = []
    with running_bench() as bench, disturbances(bench) as everything:
        rights = has_rights(bench)
        for disturbance in everything:
            quiet, disturbed = (
                bench.compare(disturbance, QUICK_S if quick else SECONDS)
                if rights
                else (Seen(), Seen())
            )
            found += compared(disturbance.name, quiet, disturbed, rights)
    return found


def compared(name: str, quiet: Seen, disturbed: Seen, rights: bool) -> list[Figure]:
    """Return the figures of one disturbance."""
    why = "" if rights else "; the loop has no real-time priority here"

    def late(part: Timing) -> TimeHistogram:
        return part.wake_late

    def work(part: Timing) -> TimeHistogram:
        return part.work

    loops = quiet.loop, disturbed.loop
    return [
        _ratio(f"{name}: wake-up p99 to that without", *loops, late, why),
        _ratio(f"{name}: work p99 to that without", *loops, work, why),
        Figure(
            f"{name}: age of the supervisor's heartbeat, p99",
            _p99(disturbed.heartbeat_ms),
            "ms",
            HEARTBEAT_LIMIT_ms,
            note=f"{number(_p99(quiet.heartbeat_ms))} ms without{why}",
        ),
    ]


def _p99(values: list[float]) -> float:
    return float(np.quantile(values, 0.99)) if values else float("nan")


def _ratio(
    what: str,
    quiet: MeasuredSlices,
    disturbed: MeasuredSlices,
    of: Callable[[Timing], TimeHistogram],
    why: str,
) -> Figure:
    before_us, with_us = (
        median_of_slices_us([of(part) for part in slices.clean], 0.99)
        for slices in (quiet, disturbed)
    )
    note = (
        f"{number(with_us)} to {number(before_us)} us; "
        f"{len(disturbed.clean)} and {len(quiet.clean)} clean slices{why}"
    )
    ratio = max(with_us, FLOOR_us) / max(before_us, FLOOR_us)
    return Figure(what, ratio, "", RATIO_LIMIT, note=note)
