"""What a tick is made of, and the loop process at 10 kHz with a reader of its ring.

The parts are timed where they are called: in a loop that waits for 1 kHz deadlines between its
ticks, so that caches are as cold as they are in the daemon.
"""

import statistics
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from motord import config
from motord.control import parameters
from motord.control.types import COMMAND, FEEDBACK, SETPOINT
from motord.hal.registry import make_rig
from motord.loop import rt_setup
from motord.loop.control_loop import ControlLoop, StopRequest
from motord.loop.hybrid_sleep import HybridSleep
from motord.loop.latency.measurement import choose_cpu
from motord.loop.pacer import Pacer
from motord.loop.status import LoopPhase, LoopStatus
from motord.loop.tick_kernel import NO_WORK, run_tick
from motord.shm.mailbox import MailboxReader, MailboxWriter
from motord.shm.ring import RingReader, RingWriter
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesReader, TablesWriter
from motord.unix_clock import Clock
from tests.benchmarks.figure import Figure
from tests.support.loop_process import start_loop

KERNEL_LIMIT_us = 3.0
PERIOD_ns = 1_000_000
PARTS = (
    "read the simulated rig",
    "mailbox and tables",
    "control kernel",
    "write the rig",
    "publish",
)
FAST_Hz = 10_000
READ_EVERY_S = 0.05


def make_cycle(bench: config.Config, folder: Path) -> tuple[ControlLoop, MailboxWriter]:
    """Return a loop's parts with files in `folder`, warmed up."""
    TablesWriter(folder / "tables", bench.motor.counts).write(*parameters.build(bench))
    writer = MailboxWriter(folder / "setpoint", Clock.measure())
    writer.write(np.zeros(1, SETPOINT))
    cycle = ControlLoop(
        make_rig(bench),
        RingWriter(folder / "ring", 16384),
        MailboxReader(folder / "setpoint"),
        TablesReader(folder / "tables"),
        StopRequest(),
    )
    cycle.warm_up_kernel()
    cycle.rig.open()
    cycle.warm_up_rig()
    return cycle, writer


def part_costs_us(ticks: int) -> np.ndarray:
    """Return what each part took in each tick, shape (ticks, len(PARTS)).

    Takes the loop's real-time rights, so it wants a process of its own.
    """
    with tempfile.TemporaryDirectory() as name:
        cycle, _writer = make_cycle(config.load(), Path(name))
        rt_setup.apply(choose_cpu(config.load().loop))
        costs_us = timed_ticks_us(cycle, ticks)
        cycle.rig.close()
    return costs_us


def timed_ticks_us(cycle: ControlLoop, ticks: int) -> np.ndarray:
    """Run the parts of a tick at 1 kHz; return what each took, shape (ticks, len(PARTS))."""
    rig, ring, clock = cycle.rig, cycle.ring, time.perf_counter_ns
    feedback, setpoint, command = (np.zeros(1, d) for d in (FEEDBACK, SETPOINT, COMMAND))
    cycle.feedback, cycle.setpoint, cycle.command = feedback, setpoint, command
    bound = cycle.kernel()
    pacer = Pacer(PERIOD_ns, HybridSleep(PERIOD_ns))
    marks = np.zeros((ticks, len(PARTS) + 1), np.int64)
    for tick in range(ticks):
        now_ns = pacer.wait() + cycle.mailbox.clock.offset_ns
        row = [clock()]
        rig.read(now_ns, feedback)
        row.append(clock())
        cycle.mailbox.read(setpoint)
        cycle.tables.poll()
        row.append(clock())
        run_tick(bound.frame, ring.index, tick, 0, 0, pacer.late_ns, NO_WORK)
        row.append(clock())
        rig.write(command)
        row.append(clock())
        ring.publish()
        row.append(clock())
        marks[tick] = row
    return np.diff(marks, axis=1) / 1e3


def kernel_alone_us(rounds: int = 31, calls: int = 2000) -> float:
    """Return the median cost of a call of the kernel, called again and again."""
    with tempfile.TemporaryDirectory() as name:
        cycle, _writer = make_cycle(config.load(), Path(name))
        bound = cycle.kernel()
        costs_us = []
        for _ in range(rounds):
            begun_ns = time.perf_counter_ns()
            for _ in range(calls):
                run_tick(bound.frame, 0, 1, 0, 0, 50, NO_WORK)
            costs_us.append((time.perf_counter_ns() - begun_ns) / calls / 1e3)
        cycle.rig.close()
    return statistics.median(costs_us)


def at_rate(rate_Hz: int, folder: Path) -> Path:
    """Write the packaged simulated bench with another loop rate; return its path."""
    text = config.packaged("sim.toml").read_text()
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    old = f"rate_Hz = {config.load().loop.rate_Hz}"
    path = folder / "sim.toml"
    path.write_text(text.replace(old, f"rate_Hz = {rate_Hz}", 1))
    return path


class Followed:
    """The loop process with a reader that takes all its ticks."""

    def __init__(self) -> None:
        self.read = self.lost = self.gaps = 0
        self._last_tick = -1
        self._reader: RingReader | None = None

    def run(self, rate_Hz: int, seconds: float) -> LoopStatus:
        """Run the loop for `seconds` worth of ticks and return its account."""
        with tempfile.TemporaryDirectory() as name:
            config_path = at_rate(rate_Hz, Path(name))
            bench = config.load(config_path)
            with RunDir(bench.bench.name, Path(name) / "run").hold() as run_dir:
                mailbox = MailboxWriter(run_dir.setpoint, Clock.measure())
                TablesWriter(run_dir.tables, bench.motor.counts).write(*parameters.build(bench))
                with start_loop(config_path, run_dir) as process:
                    wanted = round(seconds * rate_Hz)
                    while process.poll() is None and self._last_tick < wanted:
                        mailbox.write(np.zeros(1, SETPOINT))
                        self._follow(run_dir)
                        time.sleep(READ_EVERY_S)
                    process.terminate()
                    process.wait()
                self._follow(run_dir)
                status = LoopStatus.read(run_dir.loop_status)
        if status is None or status.phase != LoopPhase.STOPPED:
            raise RuntimeError(f"the loop failed: {status.error if status else 'no status'}")
        return status

    def _follow(self, run_dir: RunDir) -> None:
        if self._reader is None:
            status = LoopStatus.read(run_dir.loop_status)
            if status is None or status.phase != LoopPhase.READY:
                return
            self._reader = RingReader(run_dir.ring, "oldest")
        block, lost = self._reader.read()
        self.lost += lost
        self.read += len(block)
        if len(block):
            ticks = np.concatenate([[self._last_tick], block["tick"].astype(np.int64)])
            self.gaps += int((np.diff(ticks) - 1).sum())
            self._last_tick = int(ticks[-1])


def figures(quick: bool) -> list[Figure]:
    """Return the cost of the parts of a tick, and what a reader at 10 kHz gets."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        costs_us = process.submit(part_costs_us, 500 if quick else 5000).result()
    found = [
        Figure(
            f"a tick: {part}, p50",
            float(np.median(costs_us[:, n])),
            "us",
            KERNEL_LIMIT_us if part == "control kernel" else None,
            note=f"p99 {np.quantile(costs_us[:, n], 0.99):.3g} us, at 1 kHz",
        )
        for n, part in enumerate(PARTS)
    ]
    found.append(Figure("control kernel, called again and again", kernel_alone_us(), "us"))
    return found + follow(5.0 if quick else 60.0)


def follow(seconds: float) -> list[Figure]:
    """Return the figures of the loop process at 10 kHz."""
    followed = Followed()
    status = followed.run(FAST_Hz, seconds)
    at = f"{FAST_Hz / 1000:g} kHz for {seconds:g} s"
    unread = status.ticks - followed.read
    return [
        Figure(
            f"{at}: ticks lost by the ring's reader",
            followed.lost + unread,
            "",
            0,
            note=f"of {status.ticks}; read every {READ_EVERY_S * 1e3:g} ms",
        ),
        Figure(
            f"{at}: periods skipped but not counted in `missed`",
            abs(status.missed - followed.gaps),
            "",
            0,
            note=f"{status.missed} skipped: {100 * status.missed / (seconds * FAST_Hz):.1f} %",
        ),
        Figure(
            f"{at}: loop work, p50",
            status.work.p50_us,
            "us",
            note=f"p99 {status.work.p99_us:.3g} us, stolen time and all",
        ),
    ]
