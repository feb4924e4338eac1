"""What a tick costs: the kernel, the shared memory, and the whole loop in real time.

    python -m tests.benchmarks.bench_loop [--json FILE] [--rate-Hz R] [--seconds S]

The parts are timed in alternating rounds, so that a disturbance of the machine hits all of them;
a figure is the median of the rounds. Ratios compare with the limits below.
"""

import argparse
import json
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from motord import config
from motord.control import parameters
from motord.control import step as kernel
from motord.control.types import COMMAND, FEEDBACK, SETPOINT
from motord.hal.registry import make_rig
from motord.runtime.clock import Clock
from motord.runtime.histogram import TimeHistogram
from motord.runtime.launch import start_loop
from motord.runtime.mailbox import MailboxReader, MailboxWriter
from motord.runtime.pacer import Pacer
from motord.runtime.ring import RingReader, RingWriter
from motord.runtime.rundir import RunDir
from motord.runtime.status import LoopStatus, Phase
from motord.runtime.tables import TablesReader, TablesWriter
from motord.runtime.waker import Waker

ROUNDS = 31
CALLS = 2000
KERNEL_LIMIT_ns = 3_000.0
WORK_P99_LIMIT_us = 40.0

Parts = dict[str, Callable[[], object]]


def parts_of_a_tick(bench: config.Config, folder: Path) -> Parts:
    """Return what a tick is made of, each ready to be called again and again."""
    tables_writer = TablesWriter(folder / "tables", bench.motor.counts)
    tables_writer.write(*parameters.build(bench))
    tables = TablesReader(folder / "tables")
    tables.poll()
    writer = MailboxWriter(folder / "setpoint", Clock.measure())
    reader = MailboxReader(folder / "setpoint")
    ring = RingWriter(folder / "ring", 16384)
    histogram = TimeHistogram()
    rig = make_rig(bench)
    rig.open()
    memory, feedback = kernel.new_memory(), np.zeros(1, FEEDBACK)
    setpoint, command = np.zeros(1, SETPOINT), np.zeros(1, COMMAND)
    writer.write(setpoint)
    clock = time.monotonic_ns
    pacer = Pacer(1, Waker(1_000_000))
    rig.read(clock(), feedback)

    def exchange() -> None:
        writer.write(setpoint)
        reader.read(setpoint)

    def rig_tick() -> None:
        rig.read(clock(), feedback)
        rig.write(command)

    return {
        "control kernel": lambda: kernel.step(
            *tables.current, memory, feedback, setpoint, command, ring.slot()
        ),
        "ring slot and publish": lambda: (ring.slot(), ring.publish()),
        "mailbox, nothing new": lambda: reader.read(setpoint),
        "mailbox, write and read": exchange,
        "tables, nothing new": tables.poll,
        "histogram": lambda: histogram.add(54_321),
        "pacer without waiting": pacer.wait,
        "simulated rig, read and write": rig_tick,
    }


def time_parts(parts: Parts) -> dict[str, float]:
    """Return the median cost of a call in ns, over alternating rounds."""
    rounds: dict[str, list[float]] = {name: [] for name in parts}
    for _ in range(ROUNDS):
        for name, part in parts.items():
            begun_ns = time.perf_counter_ns()
            for _ in range(CALLS):
                part()
            rounds[name].append((time.perf_counter_ns() - begun_ns) / CALLS)
    return {name: statistics.median(costs) for name, costs in rounds.items()}


def run_loop(config_path: Path, seconds: float, folder: Path) -> LoopStatus:
    """Run the loop process for `seconds` and return its account."""
    bench = config.load(config_path)
    with RunDir(bench.bench.name, folder / "run").hold() as run_dir:
        mailbox = MailboxWriter(run_dir.setpoint, Clock.measure())
        TablesWriter(run_dir.tables, bench.motor.counts).write(*parameters.build(bench))
        setpoint = np.zeros(1, SETPOINT)
        with start_loop(config_path, run_dir) as process:
            wanted = round(seconds * bench.loop.rate_Hz)
            reader: RingReader | None = None
            while process.poll() is None and (reader is None or reader.head < wanted):
                mailbox.write(setpoint)
                status = LoopStatus.read(run_dir.loop_status)
                if reader is None and status and status.phase == Phase.READY:
                    reader = RingReader(run_dir.ring)
                time.sleep(0.02)
            process.send_signal(signal.SIGTERM)
            process.wait()
        status = LoopStatus.read(run_dir.loop_status)
    if status is None or status.phase != Phase.STOPPED:
        raise SystemExit(f"bench_loop: the loop failed: {status.error if status else 'no status'}")
    return status


def at_rate(rate_Hz: int, folder: Path) -> Path:
    """Write the packaged simulated bench with another loop rate; return its path."""
    text = config.packaged("sim.toml").read_text()
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    old = f"rate_Hz = {config.load().loop.rate_Hz}"
    path = folder / "sim.toml"
    path.write_text(text.replace(old, f"rate_Hz = {rate_Hz}"))
    return path


def measure(rate_Hz: int, seconds: float) -> dict[str, object]:
    """Return all results."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        config_path = at_rate(rate_Hz, folder)
        costs_ns = time_parts(parts_of_a_tick(config.load(config_path), folder))
        loop = run_loop(config_path, seconds, folder)
    quantiles = {"p50_us", "p99_us", "p999_us", "max_us", "samples"}
    return {
        "parts_ns": costs_ns,
        "rate_Hz": rate_Hz,
        "wake_late": loop.wake_late.model_dump(include=quantiles),
        "work": loop.work.model_dump(include=quantiles),
        "missed": loop.missed,
        "realtime": loop.realtime.lines() if loop.realtime else [],
        "ratios": {
            "kernel_to_limit": costs_ns["control kernel"] / KERNEL_LIMIT_ns,
            "work_p99_to_limit": loop.work.p99_us / WORK_P99_LIMIT_us,
            "work_p50_to_period": loop.work.p50_us * 1e-6 * rate_Hz,
        },
    }


def print_table(results: dict[str, object]) -> None:
    """Print the results for people."""
    lines = ["cost of a call, median"]
    lines += [f"  {n:32} {v / 1e3:9.2f} us" for n, v in _items(results["parts_ns"])]
    lines += [f"loop process at {results['rate_Hz']} Hz, simulated rig"]
    for name in ("wake_late", "work"):
        figures = "  ".join(f"{k[:-3]} {v:8.1f}" for k, v in _items(results[name]) if "_us" in k)
        lines += [f"  {name:10} {figures}  us"]
    lines += [f"  missed     {results['missed']}", "ratios"]
    lines += [f"  {n:32} {v:9.3f}" for n, v in _items(results["ratios"])]
    sys.stdout.write("\n".join(lines) + "\n")


def _items(table: object) -> list[tuple[str, float]]:
    assert isinstance(table, dict)
    return list(table.items())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--json", type=Path, help="write the results to this file")
    parser.add_argument("--rate-Hz", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    results = measure(options.rate_Hz, options.seconds)
    print_table(results)
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
