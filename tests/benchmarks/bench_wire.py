"""The highest rate that holds on the wire, for each python-can interface usable on one computer.

The loop process runs on one processor, the other ends of its wires on another: an inverter over
CAN and a bridge board behind a pseudo-terminal. The rate goes up in steps. It holds if, in the
median of the slices from which the host stole no time, 99 % of the ticks end their work within the
period and at most 1 % of the periods are missed; the first that does not twice ends the climb. With
the fixed peer (`wire_peer`), whose frames are made beforehand, the loop is what limits;
`motord emulate` has to keep up as well.

Interfaces: UDP multicast that does not leave the computer, and slcan over a pseudo-terminal. The
virtual bus of python-can ends at its process, so only the cost of the drivers' calls is measured.
"""

import gc
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from motord import config
from motord.control import parameters
from motord.control.types import SETPOINT
from motord.hal.bridge.serial import SerialBridge
from motord.hal.inverter.can_drive import CanInverter
from motord.loop.latency.measurement import MeasuredSlices, median_of_slices_us, stolen_ticks
from motord.loop.status import LoopPhase, LoopStatus
from motord.shm.mailbox import MailboxWriter
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesWriter
from motord.shm.timing import Timing
from motord.unix_clock import Clock
from tests.benchmarks.figure import Figure, number
from tests.contract.benches import new_command, new_feedback
from tests.contract.peers import Board, Drive, bench, can_config
from tests.support.loop_process import start_loop
from tests.unit.emulate.benches import write_bench

RATES_Hz = (250, 500, 1000, 1500, 2000, 3000, 4000, 5000, 8000, 10_000)
QUICK_RATES_Hz = (500, 2000)
USUAL_Hz = 1000
SLICE_S, ACCOUNT_S = 0.25, 0.02
ENOUGH_CLEAN, SECONDS, QUICK_S = 12, 8.0, 1.0
MISSED_MAX = 0.01
SKIPPED_MAX = 0.02
"""Of the emulator, which leaves instants out when it is a fifth of a second behind."""
TRIES = 2
"""Of a rate that does not hold: the computer may have had something else to do."""
TICKS, QUICK_TICKS = 3000, 500
START_S = 60.0
INTERFACES = ("udp_multicast", "slcan")


@dataclass
class Step:
    """What came out at one rate: the loop's slices, what its peer said of itself."""

    rate_Hz: int
    emulated: bool = False
    slices: MeasuredSlices = field(default_factory=MeasuredSlices)
    peer: dict[str, Any] = field(default_factory=dict)

    @property
    def work_us(self) -> tuple[float, float]:
        """Median over clean slices of work p50 and p99."""
        work = [part.work for part in self.slices.clean]
        return median_of_slices_us(work, 0.5), median_of_slices_us(work, 0.99)

    @property
    def missed(self) -> float:
        """Median over clean slices of the share of periods that the loop missed."""
        shares = [part.missed / max(_periods(part), 1) for part in self.slices.clean]
        return statistics.median(shares) if shares else float("nan")

    @property
    def peer_skipped(self) -> float:
        """Share of its instants that the peer left out, stolen time and all."""
        skipped, ticks = self.peer["skipped"], self.peer["ticks"]
        return float(skipped / max(ticks + skipped, 1))

    @property
    def limits(self) -> str:
        """Who does not keep up with this rate; nobody if it holds or could not be judged."""
        if not self.slices.clean:
            return ""
        if not (self.work_us[1] < 1e6 / self.rate_Hz and self.missed <= MISSED_MAX):
            return "the loop"
        return "the emulator" if self.emulated and self.peer_skipped > SKIPPED_MAX else ""

    def note(self) -> str:
        """Return what else there is to say of it."""
        peer_us = 1e6 * self.peer["cpu_s"] / max(self.peer["ticks"], 1)
        return (
            f"p50 {number(self.work_us[0])} us of {1e6 / self.rate_Hz:g}; "
            f"missed {100 * self.missed:.2g} %; {len(self.slices.clean)} clean slices; "
            f"peer {number(peer_us)} us a tick, skipped {100 * self.peer_skipped:.2g} %"
        )


def _periods(part: Timing) -> int:
    return int(part.wake_late.counts.sum()) + part.missed


def write_config(folder: Path, interface: str, rate_Hz: int, cpu: int) -> Path:
    """Write a bench on the wire into `folder`."""
    changes = {
        "rate_Hz = 1000": f"rate_Hz = {rate_Hz}\ncpu = {cpu}",
        "rig_patience_s = 0.005": "rig_patience_s = 0.2",  # what it then skips, it cannot do
    }
    path = write_bench(folder, changes)
    text = path.read_text()
    if interface == "slcan":
        lines = [
            'interface = "slcan"',
            f'channel = "{folder / "slcan"}"',
            "fd = true",
            "options = {sleep_after_open = 0.0}",
        ]
        begin, end = text.index('interface = "udp_multicast"'), text.index('dbc = "package:')
        path.write_text(text[:begin] + "\n".join(lines) + "\n" + text[end:])
    return path


@contextmanager
def peer(command: list[str], cpu: int) -> Iterator[dict[str, Any]]:
    """Run a peer on processor `cpu`; what it says at its end is in the dict afterwards."""
    result: dict[str, Any] = {}
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        try:
            os.sched_setaffinity(process.pid, {cpu})
            if not process.stdout.readline():
                raise RuntimeError("the other ends of the wires did not start")
            yield result
        finally:
            process.terminate()
            last = process.stdout.read().splitlines()
            process.wait()
    result.update(json.loads(last[-1]))


@contextmanager
def loop(path: Path, folder: Path) -> Iterator[tuple[Timing, Callable[[], None]]]:
    """Run the loop of the bench at `path`; yields what it counts, and a heartbeat for it."""
    setup = config.load(path)
    with RunDir(setup.bench.name, folder / "run").hold() as run_dir:
        mailbox = MailboxWriter(run_dir.setpoint, Clock.measure())
        TablesWriter(run_dir.tables, setup.motor.counts).write(*parameters.build(setup))
        with start_loop(path, run_dir) as process:
            try:
                await_loop(run_dir, process)
                yield Timing.attach(run_dir.timing), lambda: mailbox.write(np.zeros(1, SETPOINT))
            finally:
                process.terminate()
                process.wait()


def await_loop(run_dir: RunDir, process: "subprocess.Popen[bytes]") -> None:
    """Wait until the loop publishes ticks. Raises RuntimeError if it does not."""
    end_s = time.monotonic() + START_S
    while process.poll() is None and time.monotonic() < end_s:
        status = LoopStatus.read(run_dir.loop_status)
        if status is not None and status.phase is LoopPhase.READY:
            return
        time.sleep(0.05)
    status = LoopStatus.read(run_dir.loop_status)
    raise RuntimeError(f"the loop did not start: {status.error if status else 'no status'}")


def at_rate(interface: str, rate_Hz: int, seconds: float, *, emulated: bool = False) -> Step:
    """Run the loop at a rate and return what came out."""
    cpus = sorted(os.sched_getaffinity(0))
    ours, theirs = cpus[-1], cpus[0]
    step = Step(rate_Hz, emulated)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = write_config(folder, interface, rate_Hz, ours)
        command = [sys.executable, "-m", "tests.benchmarks.wire_peer", str(path), str(theirs)]
        if emulated:
            command = [sys.executable, "-m", "motord", "emulate", "-c", str(path), "--json"]
        with peer(command, theirs) as step.peer, loop(path, folder) as (live, beat):
            end_s = time.monotonic() + seconds
            while time.monotonic() < end_s and len(step.slices.clean) < ENOUGH_CLEAN:
                beat()
                stolen, before = stolen_ticks(ours), live.copy()
                time.sleep(SLICE_S)
                part = live.copy().since(before)
                time.sleep(ACCOUNT_S)
                clean = stolen_ticks(ours) == stolen
                (step.slices.clean if clean else step.slices.stolen).append(part)
    return step


def climb(interface: str, quick: bool, *, emulated: bool = False) -> list[Step]:
    """Go up the rates until one does not hold."""
    steps: list[Step] = []
    for rate_Hz in QUICK_RATES_Hz if quick else RATES_Hz:
        for _ in range(TRIES):
            seconds = QUICK_S if quick else SECONDS
            step = at_rate(interface, rate_Hz, seconds, emulated=emulated)
            sys.stderr.write(f"  {interface} {rate_Hz} Hz: {step.note()}\n")
            if not step.limits:
                break
        steps.append(step)
        if step.limits:
            break
    return steps


def highest(name: str, steps: list[Step]) -> list[Figure]:
    """Return the highest rate that holds, and the work at each."""
    held = [step.rate_Hz for step in steps if step.slices.clean and not step.limits]
    note = "higher ones were not tried"
    if steps[-1].limits:
        note = f"at {steps[-1].rate_Hz} Hz {steps[-1].limits} does not keep up"
    top = Figure(
        f"{name}: highest rate that holds",
        max(held, default=float("nan")),
        "Hz",
        USUAL_Hz,
        "at least",
        note=note,
    )
    every = [
        Figure(f"{name} at {s.rate_Hz} Hz: work p99", s.work_us[1], "us", note=s.note())
        for s in steps
    ]
    return [top, *every]


class Rig:
    """Both drivers in this thread, and peers that speak on command."""

    def __init__(self, interface: str) -> None:
        can = can_config(interface)
        self.drive, self.board = Drive(can), Board()
        setup = bench(can, self.board.port)
        self.inverter, self.bridge = CanInverter(setup), SerialBridge(setup)
        self.inverter.open()
        self.bridge.open()
        for other in (self.drive, self.board):
            other.silent = True
            other.stop()

    def speak(self) -> None:
        self.drive.receive()
        self.board.receive()
        self.drive.speak()
        self.board.speak()

    def close(self) -> None:
        self.inverter.close()
        self.bridge.close()
        self.drive.release()
        self.board.release()


def costs(interface: str, ticks: int) -> list[Figure]:
    """Return what the drivers' calls of a tick cost, the peers speaking before each."""
    rig, feedback, command = Rig(interface), new_feedback(), new_command((1.0, -2.0, 1.0), 1)
    calls: dict[str, Callable[[], None]] = {
        "bridge read": lambda: rig.bridge.read(time.time_ns(), feedback),
        "inverter read": lambda: rig.inverter.read(time.time_ns(), feedback),
        "inverter write": lambda: rig.inverter.write(command),
        "bridge write": lambda: rig.bridge.write(command),
    }
    taken_us = np.zeros((ticks, len(calls)))
    gc.disable()
    for tick in range(ticks):
        rig.speak()
        for place, call in enumerate(calls.values()):
            begun_ns = time.perf_counter_ns()
            call()
            taken_us[tick, place] = (time.perf_counter_ns() - begun_ns) * 1e-3
    gc.enable()
    rig.close()
    parts = ", ".join(
        f"{name} {number(statistics.median(column))}"
        for name, column in zip(calls, taken_us.T, strict=True)
    )
    whole_us = float(np.median(taken_us.sum(axis=1)))
    what = f"{interface}: the drivers' calls of a tick, p50"
    return [Figure(what, whole_us, "us", note=f"{parts}; caches warm")]


def figures(quick: bool) -> list[Figure]:
    """Return costs of the drivers and the highest rates, for each interface and the emulator."""
    found = []
    for interface in ("udp_multicast", "virtual"):
        found += costs(interface, QUICK_TICKS if quick else TICKS)
    for interface in INTERFACES:
        found += highest(interface, climb(interface, quick))
    emulated = climb(INTERFACES[0], quick, emulated=True)
    return found + highest(f"{INTERFACES[0]} to `motord emulate`", emulated)
