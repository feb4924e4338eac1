"""What goes wrong around a running bench, and what the loop feels of it.

The daemon runs the simulated bench and records it, with the loop on one processor. Slices of a
tenth of a second in which all is well alternate, eight at a time, with slices in which something is
not, the one first in every other pair of eight and eight. A pair gives a ratio of medians over its
slices from which the host stole no time; figures are medians of these ratios, with 95 % intervals
(`paired`). The loop's own histograms are read, so that measuring costs it nothing.

The supervisor's heartbeat is looked at meanwhile, every few milliseconds from another process: it
must not be held up by what its other threads and processes wait for.
"""

import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motord import config
from motord.control.types import SETPOINT
from motord.loop.latency.measurement import choose_cpu, stolen_ticks
from motord.shm.mailbox import MailboxReader
from motord.shm.run_directory import RunDir
from motord.shm.timing import Timing
from tests.benchmarks.figure import Figure
from tests.benchmarks.paired import Pair, Seen, compared, heartbeat
from tests.support.patience import until
from tests.system.daemons import Daemon, daemon, wait_for, write_sim
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
SLICES = 8
ENOUGH_PAIRS = 40
SECONDS, QUICK_S = 45.0, 4.0
FULL_BYTES = 100_000
"""Telemetry that a subscriber has not read: far more than it has room for."""


@dataclass(frozen=True)
class Disturbance:
    """What goes wrong: `begin` and `end` return when it has begun, and when all is well again."""

    name: str
    begin: Callable[[], object]
    end: Callable[[], object]


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

    def slices(self) -> Seen:
        """Return the next SLICES."""
        seen = Seen()
        for _ in range(SLICES):
            self.take(seen)
        return seen

    def compare(self, disturbance: Disturbance, seconds: float) -> list[Pair]:
        """Return pairs of slices without and with the disturbance, in alternating order."""

        def disturbed() -> Seen:
            disturbance.begin()
            seen = self.slices()
            disturbance.end()
            return seen

        pairs: list[Pair] = []
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s and sum(pair.counts for pair in pairs) < ENOUGH_PAIRS:
            if len(pairs) % 2 == 0:
                pairs.append(Pair(quiet=self.slices(), disturbed=disturbed()))
            else:
                pairs.append(Pair(disturbed=disturbed(), quiet=self.slices()))
        return pairs


@contextmanager
def running_bench(rate_Hz: int = RATE_Hz, tick_rate_Hz: float = 1000.0) -> Iterator[Bench]:
    """Run the simulated bench at `rate_Hz` with its loop on the last processor."""
    cpu = choose_cpu(config.load().loop).cpu
    assert cpu is not None
    with tempfile.TemporaryDirectory() as name:
        path = write_sim(Path(name), "isolation")
        text = path.read_text().replace("rate_Hz = 500", f"rate_Hz = {rate_Hz}\ncpu = {cpu}")
        text = text.replace("overrun_ticks = 500", f"overrun_ticks = {rate_Hz}")
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
            until(lambda: unsent_bytes(bench.endpoint) > FULL_BYTES, "the link to be full")

        def resume_subscriber() -> None:
            other.send_signal(signal.SIGCONT)
            until(lambda: unsent_bytes(bench.endpoint) == 0, "the link to be empty")

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
            pairs = bench.compare(disturbance, QUICK_S if quick else SECONDS) if rights else []
            found += compared(disturbance.name, pairs, rights)
            found.append(heartbeat(disturbance.name, pairs, rights))
    return found
