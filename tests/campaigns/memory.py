"""Does the memory of any process grow?

`python -m tests.campaigns.memory [--virtual-s 3600] [--real-s 600] [--sim]`: an hour of virtual
time, one bench on which plan after plan is carried out and recorded, in one process; then ten
minutes of real time on the wire (with --sim on the simulated rig): emulator, supervisor, loop and
recorder and a client that subscribes to everything and has plan after plan carried out. Every
process is looked at once a second. Its memory of its own (anonymous) and what it holds in all (RSS,
with mapped files, the ring among them) may grow by less than 1 % from the tenth after the warm-up
to the last.
"""

import argparse
import multiprocessing
import os
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from motord import config
from motord.client import ClientError
from motord.experiments.plans import build
from motord.recording.writer import RunWriter
from motord.sequencing import Plan
from motord.virtual.bench import VirtualBench
from motord.virtual.plan import run_plan
from tests.system.daemons import daemon, emulator, patient, write_sim
from tests.unit.emulate.benches import write_bench

LIMIT_PERCENT = 1.0
LEAST_KB = 256
"""Growth that is none: a few pages of the allocator, of a process of some ten MB."""
WARM_UP, WINDOW = 0.2, 0.1
LOOK_S = 1.0
KINDS = ("Anonymous", "Rss", "Pss")
JUDGED = KINDS[:2]
PLAN = {
    "torques_Nm": [1.0, 2.0], "speeds_Hz": [0.8, 1.0], "turns": 2, "settle_s": 0.5,
    "compensate": "off",
}  # fmt: skip


@dataclass
class Memory:
    """What a process held, in kB, look by look."""

    looks: dict[str, list[int]] = field(default_factory=lambda: {kind: [] for kind in KINDS})

    def look(self, pid: int) -> None:
        """Take down what there is now."""
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
        held = dict(line.split(":", 1) for line in text.splitlines()[1:])
        for kind in KINDS:
            self.looks[kind].append(int(held[kind].split()[0]))

    def before_after(self, kind: str) -> tuple[float, float]:
        """Return the median (kB) of the window after the warm-up and of the last."""
        looks = self.looks[kind]
        size = max(round(WINDOW * len(looks)), 1)
        first = round(WARM_UP * len(looks))
        return statistics.median(looks[first : first + size]), statistics.median(looks[-size:])

    def grew(self, kind: str) -> float:
        """Return the growth in percent."""
        before, after = self.before_after(kind)
        return 100 * (after / before - 1)

    def flat(self, kind: str) -> bool:
        """Return whether there was no growth to speak of."""
        before, after = self.before_after(kind)
        return self.grew(kind) < LIMIT_PERCENT or after - before < LEAST_KB


@contextmanager
def watched(pids: dict[str, int]) -> Iterator[dict[str, Memory]]:
    """Look at processes once a second for as long as the block runs."""
    memories, over = {name: Memory() for name in pids}, threading.Event()

    def watch() -> None:
        while not over.wait(LOOK_S):
            for name, pid in pids.items():
                try:
                    memories[name].look(pid)
                except (OSError, ValueError):
                    return  # it has ended

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield memories
    finally:
        over.set()
        thread.join()


def record_plan(bench: VirtualBench, plan: Plan, path: Path) -> int:
    """Carry out a plan in virtual time, recorded as the daemon would; return its ticks."""
    ticks = [0]
    with RunWriter(path, {"plan": plan.name}) as writer:

        def write(block: np.ndarray, truth: np.ndarray) -> None:
            writer.ticks(block)
            writer.truth(truth)
            ticks[0] += len(block)

        for point in run_plan(bench, plan, write):
            writer.operating_point(int(point["t_end_ns"]), point)
    return ticks[0]


def operate_virtually(seconds: float) -> None:
    """Carry out plan after plan on one virtual bench, each recorded, for so long."""
    bench_config = config.load(config.packaged("sim.toml"))
    bench, plan = VirtualBench(bench_config), build("verify", bench_config, PLAN)
    wanted = seconds * bench_config.loop.rate_Hz
    with tempfile.TemporaryDirectory(prefix="motord-memory-", ignore_cleanup_errors=True) as name:
        path = Path(name) / "run.mcap"
        while wanted > 0:
            wanted -= record_plan(bench, plan, path)
            path.unlink()


def in_virtual_time(seconds: float) -> dict[str, Memory]:
    """Return the memory of a process that operates for so long in virtual time."""
    process = multiprocessing.get_context("spawn").Process(target=operate_virtually, args=[seconds])
    process.start()
    with watched({"virtual bench": process.pid or 0}) as memories:
        process.join()
    if process.exitcode:
        raise RuntimeError(f"the virtual bench ended with {process.exitcode}")
    return memories


def on_the_wire(seconds: float) -> dict[str, Memory]:
    """Return the memory of every process of a bench on the wire that operates for so long."""
    with tempfile.TemporaryDirectory(prefix="motord-memory-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        bench = write_bench(folder)
        text = patient(bench.read_text(), "memory")
        bench.write_text(text.replace("[brake]\n", "[brake]\nstale_after_s = 5.0\n"))
        with emulator(folder, bench, folder / "truth.mcap") as devices:
            return _in_real_time(folder, bench, seconds, {"emulator": devices.process.pid})


def on_the_simulated_rig(seconds: float) -> dict[str, Memory]:
    """Return the memory of every process of a simulated bench that operates for so long."""
    with tempfile.TemporaryDirectory(prefix="motord-memory-", ignore_cleanup_errors=True) as name:
        return _in_real_time(Path(name), write_sim(Path(name)), seconds, {})


def _in_real_time(
    folder: Path, bench: Path, seconds: float, others: dict[str, int]
) -> dict[str, Memory]:
    with daemon(folder, bench) as running, running.connect() as client:
        children = {name: view.pid or 0 for name, view in client.state().processes.items()}
        pids = {**others, **children, "supervisor": running.process.pid, "client": os.getpid()}
        with watched(pids) as memories:
            _operate(client, seconds)
        after = {name: view.pid for name, view in client.state().processes.items()}
        running.end()
        if after != children:
            raise RuntimeError(f"a process was started again: {running.said()}")
    return memories


def _operate(client, seconds: float) -> None:
    """Subscribe to everything, command plan after plan."""
    end_s, blocks = time.monotonic() + seconds, [0]

    def count(_block: object) -> None:
        blocks[0] += 1

    with client.subscribe_ticks(count), client.subscribe_state(count):
        while time.monotonic() < end_s:
            try:
                with client.lease("memory", force=True) as lease:
                    _one_plan(client, lease.token, end_s)
            except ClientError as error:
                sys.stdout.write(f"again: {error}\n")  # a computer so busy that a lease ran out
    client.rpc("stop")
    if not blocks[0]:
        raise RuntimeError("nothing was received")


def _one_plan(client, token: str, end_s: float) -> None:
    """Carry out a plan, or as much of it as there is time for."""
    client.rpc("reset", token=token)
    view = client.plan()
    if view is not None and view.state not in ("done", "running"):
        client.rpc("plan/discard", token=token)
    client.rpc("plan/start", token=token, name="verify", settings=PLAN, detach=True)
    while not client.plan().over and time.monotonic() < end_s:
        time.sleep(0.2)


def table(memories: dict[str, Memory]) -> tuple[list[str], bool]:
    """Return the figures as lines, and whether all is flat."""
    lines, flat = [], True
    for name, memory in memories.items():
        figures = []
        for kind in KINDS:
            before, after = memory.before_after(kind)
            figures.append(
                f"{kind} {before / 1024:7.1f} -> {after / 1024:7.1f} MB {memory.grew(kind):+6.2f} %"
            )
        good = all(memory.flat(kind) for kind in JUDGED)
        flat = flat and good
        looks = len(memory.looks["Rss"])
        lines.append(f"{'ok ' if good else 'BAD'} {name:14} {', '.join(figures)} ({looks} looks)")
    return lines, flat


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--virtual-s", type=float, default=3600.0)
    parser.add_argument("--real-s", type=float, default=600.0)
    parser.add_argument("--sim", action="store_true", help="real time on the simulated rig")
    options = parser.parse_args()
    in_real_time = on_the_simulated_rig if options.sim else on_the_wire
    parts: list[tuple[Callable[[float], dict[str, Memory]], float, str]] = [
        (in_virtual_time, options.virtual_s, "virtual time"),
        (in_real_time, options.real_s, "real time"),
    ]
    every_flat = True
    for part, seconds, name in parts:
        if not seconds:
            continue
        begun_s = time.monotonic()
        lines, flat = table(part(seconds))
        took_s = time.monotonic() - begun_s
        sys.stdout.write(f"{seconds:g} s of {name}, in {took_s:.0f} s\n" + "\n".join(lines) + "\n")
        sys.stdout.flush()
        every_flat = every_flat and flat
    return 0 if every_flat else 1


if __name__ == "__main__":
    sys.exit(main())
