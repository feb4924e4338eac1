"""How late the loop wakes up and how long it works on this machine, compared with cyclictest.

Loop and cyclictest run in turn for a fraction of a second each, on the same processor, with the
same priority and period. On a virtual machine the host may stop the processor at any moment: a
slice is clean if the steal counter of its processor did not move, and slices that are not are
counted apart.
"""

import os
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from motord.config import LoopConfig
from motord.loop.latency import LatencyError, cyclictest
from motord.loop.latency.measured_loop import LoopSetup, Ready
from motord.process.module_command import module_command
from motord.process.one_thread import ONE_THREAD
from motord.process.signal_handlers import OF_TERMINAL, blocked
from motord.shm.histogram import TimeHistogram
from motord.shm.time_count import count_time
from motord.shm.timing import TIMING, Timing

SLICE_S = 0.25
SETTLE_S = 0.02
"""Unmeasured beginning of each slice: caches and margin recover from the pause."""
END_S = 10.0
"""For the loop to end by itself: the rest of a slice, and the removal of its ring."""
ENOUGH_CLEAN = 32
"""Clean slices of a kind after which there is no need to go on."""
_ACCOUNT_S = 0.01
"""Time until stolen time is in the counter."""


@dataclass(frozen=True)
class MeasurementPlan:
    """What to measure: `loop` with its rate, processor and priority, for at most `seconds`."""

    loop: LoopConfig
    seconds: float
    compare: bool = False
    slice_s: float = SLICE_S
    enough: int = ENOUGH_CLEAN

    @property
    def period_us(self) -> int:
        """The period: whole microseconds, as cyclictest takes them."""
        return round(1e6 / self.loop.rate_Hz)

    @property
    def ticks(self) -> int:
        """Measured ticks in a slice."""
        return max(1, round(self.slice_s * 1e6 / self.period_us))

    @property
    def settle_ticks(self) -> int:
        """Ticks at the beginning of a slice that are not measured."""
        return max(1, round(SETTLE_S * 1e6 / self.period_us))


@dataclass
class MeasuredSlices:
    """All slices of one kind: the clean ones, and those from which the host stole time."""

    clean: list[Timing] = field(default_factory=list)
    stolen: list[Timing] = field(default_factory=list)

    def of(self, *, clean: bool) -> Timing:
        """Return all clean slices, or all others, as one."""
        whole = Timing()
        for part in self.clean if clean else self.stolen:
            whole.merge(part)
        return whole


@dataclass
class Measured:
    """What came out: slices of the loop, and of cyclictest if it was asked for."""

    plan: MeasurementPlan
    cpu: int
    ready: Ready
    loop: MeasuredSlices = field(default_factory=MeasuredSlices)
    cyclictest: MeasuredSlices | None = None
    took_s: float = 0.0

    @property
    def kinds(self) -> list[MeasuredSlices]:
        """The kinds of slices that were measured."""
        return [self.loop] if self.cyclictest is None else [self.loop, self.cyclictest]

    @property
    def clean(self) -> int:
        """Number of clean slices of the kind that has fewer."""
        return min(len(kind.clean) for kind in self.kinds)


class LoopOnDemand:
    """The loop in a process of its own, which runs a slice on request."""

    def __init__(self, setup: LoopSetup) -> None:
        with blocked(OF_TERMINAL):
            self._process = subprocess.Popen(
                module_command("motord.loop.latency.measured_loop"),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, **ONE_THREAD},
            )
        try:
            self._send(setup.model_dump_json())
            self.ready = Ready.model_validate_json(self._receive(0))
        except BaseException:  # an interrupt, which the loop does not have
            self._end()
            raise

    def __enter__(self) -> "LoopOnDemand":
        return self

    def __exit__(self, *_error: object) -> None:
        self._end()

    def _end(self) -> None:
        """End the loop by the end of its input, for which it removes its ring; else by force."""
        try:
            self._process.communicate(timeout=END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()

    def run(self, settle_ticks: int, ticks: int) -> Timing:
        """Run `settle_ticks` and then `ticks`; return what the latter took."""
        self._send(f"{settle_ticks} {ticks}")
        answer = self._receive(TIMING.itemsize)
        return Timing(np.frombuffer(bytearray(answer), TIMING))

    def _send(self, line: str) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(line.encode() + b"\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            self._fail()

    def _receive(self, size: int) -> bytes:
        """Return `size` bytes, or a line if that is 0."""
        assert self._process.stdout is not None
        output = self._process.stdout
        answer = output.read(size) if size else output.readline()
        if len(answer) < max(size, 1):
            self._fail()
        return answer

    def _fail(self) -> None:
        self._end()
        raise LatencyError(
            f"the loop ended with code {self._process.returncode}; what it said is above"
        )


def timing_of(latencies_ns: list[int], period_ns: int) -> Timing:
    """Return wake-up latencies as a Timing.

    A latency of whole periods makes cyclictest, as it does the loop, skip the deadlines that have
    passed meanwhile; both count these as missed.
    """
    timing = Timing()
    for late_ns in latencies_ns:
        count_time(timing.wake_late.cells, late_ns)
    timing.record["missed"] = sum(late_ns // period_ns for late_ns in latencies_ns)
    return timing


def choose_cpu(loop: LoopConfig) -> LoopConfig:
    """Return `loop` pinned to a processor: its own, or the last one allowed."""
    allowed = sorted(os.sched_getaffinity(0))
    if loop.cpu is None:
        return loop.model_copy(update={"cpu": allowed[-1]})
    if loop.cpu not in allowed:
        raise LatencyError(
            f"[loop] cpu = {loop.cpu} cannot be used; allowed are {', '.join(map(str, allowed))}"
        )
    return loop


def measure(
    plan: MeasurementPlan, progress: Callable[[Measured], None] = lambda _measured: None
) -> Measured:
    """Measure until there are enough clean slices or the time is over; at least one of each.

    `progress` is called after each round. Raises LatencyError.
    """
    path = cyclictest.find() if plan.compare else ""
    loop = choose_cpu(plan.loop)
    assert loop.cpu is not None
    cpu, period_ns = loop.cpu, plan.period_us * 1000
    with LoopOnDemand(LoopSetup(loop=loop, period_ns=period_ns)) as process:
        begun_s = time.monotonic()
        measured = Measured(plan, cpu, process.ready, cyclictest=MeasuredSlices() if path else None)

        def reference() -> Timing:
            latencies_ns = cyclictest.run(
                path,
                period_us=plan.period_us,
                loops=plan.settle_ticks + plan.ticks,
                cpu=cpu,
                priority=process.ready.priority,
            )
            return timing_of(latencies_ns[plan.settle_ticks :], period_ns)

        while True:
            _take(measured.loop, cpu, lambda: process.run(plan.settle_ticks, plan.ticks))
            if measured.cyclictest is not None:
                _take(measured.cyclictest, cpu, reference)
            measured.took_s = time.monotonic() - begun_s
            progress(measured)
            if measured.clean >= plan.enough or measured.took_s >= plan.seconds:
                return measured


def _take(slices: MeasuredSlices, cpu: int, run: Callable[[], Timing]) -> None:
    before = stolen_ticks(cpu)
    timing = run()
    time.sleep(_ACCOUNT_S)
    clean = stolen_ticks(cpu) == before
    (slices.clean if clean else slices.stolen).append(timing)


def median_of_slices_us(histograms: list[TimeHistogram], fraction: float) -> float:
    """Return the median over slices of a quantile of their times; nan without any."""
    if not histograms:
        return float("nan")
    return float(np.median([part.quantile_ns(fraction) for part in histograms])) / 1e3


STAT = Path("/proc/stat")
_STEAL_COLUMN = 8


def stolen_ticks(cpu: int, stat: Path = STAT) -> int:
    """Return the steal counter of processor `cpu`, in ticks of usually 10 ms; 0 if not counted."""
    for line in stat.read_text().splitlines():
        columns = line.split()
        if columns and columns[0] == f"cpu{cpu}":
            return int(columns[_STEAL_COLUMN]) if len(columns) > _STEAL_COLUMN else 0
    return 0
