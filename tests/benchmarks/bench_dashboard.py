"""What pages cost, and how soon they show what was sampled.

The daemon runs the simulated bench at 10 kHz. Three pages without a browser have a live view of
eight signals over ten seconds, and five programs subscribe to every tick. Then slices of a tenth of
a second with all of them alternate, some at a time, with slices without any; the ratio is of the
loop's p99 over slices from which the host stole no time.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tests.benchmarks.bench_isolation import (
    Bench,
    Disturbance,
    compared,
    has_rights,
    running_bench,
)
from tests.benchmarks.figure import Figure
from tests.system.pages import Dashboard, dashboard

RATE_Hz = 10_000
PAGES, SUBSCRIBERS = 3, 5
SECONDS, QUICK_S = 60.0, 5.0
COMPARED_S, COMPARED_QUICK_S = 60.0, 4.0
CPU_LIMIT = 30.0
FRAMES_LIMIT_Hz = 20.0
DELAY_LIMIT_ms = 150.0


def cpu_s(pid: int) -> float:
    """Return the processor time of a process and its threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Clients:
    """The process of pages and subscribers."""

    def __init__(self, bench: Bench, page: Dashboard, subscribers: int = SUBSCRIBERS) -> None:
        arguments = (page.address, page.base, page.viewer, PAGES)
        where = (bench.name, bench.endpoint, subscribers)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.benchmarks.page_clients", *map(str, arguments + where)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        assert self.process.stdout is not None
        if self.process.stdout.readline() != b"ready\n":
            raise RuntimeError("the pages ended before they were open")

    def end(self) -> dict:
        """Return what they saw."""
        out, _ = self.process.communicate()
        return json.loads(out)


@contextmanager
def bench_with_page() -> Iterator[tuple[Bench, Dashboard]]:
    """Run the daemon at RATE_Hz and the page's server."""
    with (
        running_bench(RATE_Hz) as bench,
        dashboard(bench.daemon.folder, bench.endpoint) as page,
    ):
        yield bench, page


def figures(quick: bool) -> list[Figure]:
    """Return the server's load, frames and delay of the pages, losses, and the loop's ratios."""
    with bench_with_page() as (bench, page):
        found = load(bench, page, QUICK_S if quick else SECONDS)
        rights = has_rights(bench)
        clients: list[Clients] = []
        disturbance = Disturbance(
            f"{PAGES} pages, {SUBSCRIBERS} subscribers",
            lambda: clients.append(Clients(bench, page)),
            lambda: clients.pop().end(),
        )
        quiet, disturbed = bench.compare(disturbance, COMPARED_QUICK_S if quick else COMPARED_S)
    return found + compared(disturbance.name, quiet, disturbed, rights)[:2]


def load(bench: Bench, page: Dashboard, seconds: float) -> list[Figure]:
    """Return what the server needs, and what pages get of it."""
    clients = Clients(bench, page)
    before_s, begun_s = cpu_s(page.process.pid), time.monotonic()
    time.sleep(seconds)
    took_s = cpu_s(page.process.pid) - before_s
    lasted_s = time.monotonic() - begun_s
    with bench.daemon.connect() as client:
        missed = client.state().loop.missed
    seen = clients.end()["pages"]
    frames_Hz = min(one["frames"] for one in seen) / lasted_s
    delays_ms = 1e3 * np.concatenate([one["delays_s"] for one in seen])
    if not len(delays_ms):
        raise RuntimeError(f"no page received anything: {page.said()}")
    kB_per_s = sum(one["bytes"] for one in seen) / PAGES / lasted_s / 1e3
    at = f"{PAGES} pages at {RATE_Hz // 1000} kHz"
    return [
        Figure(f"{at}: processor time of the server", 100 * took_s / lasted_s, "%", CPU_LIMIT),
        Figure(f"{at}: frames, the slowest page", frames_Hz, "/s", FRAMES_LIMIT_Hz, "at least"),
        Figure(
            f"{at}: from sample to message, median",
            float(np.median(delays_ms)), "ms", DELAY_LIMIT_ms,
            note=f"95 %: {np.quantile(delays_ms, 0.95):.0f} ms",
        ),
        Figure(
            f"{at}: ticks lost on the way", max(one["lost"] for one in seen), "",
            note=f"the loop itself missed {missed}",
        ),
        Figure(f"{at}: sent to a page", kB_per_s, "kB/s"),
    ]  # fmt: skip
