"""What pages and subscribers cost at 10 kHz, and how soon pages show what was sampled.

The daemon runs the simulated bench at 10 kHz, in operation: torque and speed are set manually.
Three pages are open in Chromium, which draws without a graphics processor, each with the traces as
they are at first; five programs subscribe to every tick. A client asks meanwhile, one request
after the other. Then slices of a tenth of a second with all of them alternate with slices without
any, as in `bench_isolation`: the ratio is of the loop's p99, with its 95 % interval.
"""

import os
import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import cycle
from pathlib import Path

import numpy as np
import psutil

from motord.client import Client, Lease
from tests.benchmarks.bench_isolation import (
    Bench,
    Disturbance,
    has_rights,
    running_bench,
)
from tests.benchmarks.bench_subscribers import ROUND_TRIP_LIMIT_ms, accounted, stay
from tests.benchmarks.figure import Figure
from tests.benchmarks.open_pages import OpenPages, Seen, open_pages
from tests.benchmarks.paired import compared
from tests.system.daemons import wait_for
from tests.system.pages import Dashboard, dashboard
from tests.system.tick_accounts import Subscriber

RATE_Hz = 10_000
TICK_RATE_Hz = 100.0
PAGES, SUBSCRIBERS = 3, 5
TORQUE_Nm, SPEED_Hz = 3.0, 0.7
SECONDS, QUICK_S = 60.0, 5.0
PAUSE_S = 0.05
"""Between two requests: more than a thousand in SECONDS, and no load of their own."""
COMPARED_S, COMPARED_QUICK_S = 300.0, 8.0
LONGEST = "plan/list"
"""The request with the longest reply."""
CPU_LIMIT = 30.0
FRAMES_LIMIT_Hz = 20.0
DELAY_LIMIT_ms = 150.0
AT = f"{PAGES} pages and {SUBSCRIBERS} subscribers at {RATE_Hz // 1000} kHz"


def cpu_s(pids: Iterable[int]) -> dict[int, float]:
    """Return the processor time of each process, with its threads, that is still there."""
    found = {}
    for pid in pids:
        with suppress(OSError):
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            found[pid] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return found


def browsers() -> list[int]:
    """Return the processes of the browser that this one has started, by way of Playwright."""
    return [one.pid for one in psutil.Process().children(recursive=True) if "chrom" in one.name()]


@contextmanager
def operated(bench: Bench) -> Iterator[tuple[Client, Lease]]:
    """Hold torque and speed, set manually."""
    with bench.daemon.connect() as client, client.lease("benchmark") as lease:
        lease.enable()
        lease.set(torque_Nm=TORQUE_Nm, speed_Hz=SPEED_Hz)
        wait_for(client, lambda state: state.setpoint.torque_Nm == TORQUE_Nm, "the torque")
        yield client, lease


def figures(quick: bool) -> list[Figure]:
    """Return loads, frames, delays and losses, round trips, and the loop's ratios."""
    with ExitStack() as stack:
        bench = stack.enter_context(running_bench(RATE_Hz, TICK_RATE_Hz))
        page = stack.enter_context(dashboard(bench.daemon.folder, bench.endpoint))
        client, lease = stack.enter_context(operated(bench))
        asked: list[Callable[[], object]] = [
            partial(lease.set, torque_Nm=TORQUE_Nm),
            partial(client.rpc, LONGEST),
        ]
        pages = stack.enter_context(open_pages(f"{page.base}/#token={page.viewer}", PAGES))
        subscribers = [
            stack.enter_context(Subscriber(bench.name, bench.endpoint)) for _ in range(SUBSCRIBERS)
        ]
        found = load(cycle(asked), page, pages, subscribers, QUICK_S if quick else SECONDS)
        disturbance = Disturbance(
            AT, lambda: _begin(pages, subscribers), lambda: _end(pages, subscribers)
        )
        rights = has_rights(bench)
        pairs = bench.compare(disturbance, COMPARED_QUICK_S if quick else COMPARED_S)
    return found + compared(AT, pairs, rights)


def _begin(pages: OpenPages, subscribers: list[Subscriber]) -> None:
    for each in subscribers:
        each.begin()
    pages.open()


def _end(pages: OpenPages, subscribers: list[Subscriber]) -> None:
    pages.close()
    for each in subscribers:
        each.end()


def load(
    requests: Iterator[Callable[[], object]],
    page: Dashboard,
    pages: OpenPages,
    subscribers: list[Subscriber],
    seconds: float,
) -> list[Figure]:
    """Return what pages, subscribers and the operator get, and what they need for it.

    `requests`: `set` and LONGEST in turns.
    """
    pages.open()
    groups = [page.process.pid], browsers(), [each.process.pid for each in subscribers]
    before, begun_s = [cpu_s(pids) for pids in groups], time.monotonic()
    pages.begin()
    accounts, trips_ms = stay(lambda: next(requests)(), subscribers, seconds, PAUSE_S)
    seen, lasted_s = pages.seen(), time.monotonic() - begun_s
    after = [cpu_s(pids) for pids in groups]
    pages.close()
    server, browser, programs = (
        100 * sum(end_s - begin[pid] for pid, end_s in end.items()) / lasted_s
        for begin, end in zip(before, after, strict=True)
    )
    return [
        Figure(f"{AT}: processor time of the server", server, "%", CPU_LIMIT),
        Figure(f"{AT}: processor time of the browser", browser, "%"),
        Figure(f"{AT}: processor time of the subscribers", programs, "%"),
        *shown(seen),
        *accounted(accounts),
        round_trip("set", trips_ms[::2]),
        round_trip(LONGEST, trips_ms[1::2]),
    ]


def round_trip(name: str, trips_ms: list[float]) -> Figure:
    """Return how long a request takes."""
    return Figure(
        f"{AT}: round trip of `{name}`, median",
        statistics.median(trips_ms),
        "ms",
        ROUND_TRIP_LIMIT_ms,
        note=f"{len(trips_ms)} requests; 99 %: {np.quantile(trips_ms, 0.99):.1f} ms",
    )


def shown(seen: list[Seen]) -> list[Figure]:
    """Return what pages showed."""
    frames_Hz = [one.frames_Hz for one in seen]
    delays_ms = np.concatenate([one.delays_ms for one in seen])
    return [
        Figure(
            f"{AT}: frames, the slowest page", min(frames_Hz), "/s", FRAMES_LIMIT_Hz, "at least",
            note=f"the fastest {max(frames_Hz):.1f}/s",
        ),
        Figure(
            f"{AT}: from sample to screen, median",
            float(np.median(delays_ms)), "ms", DELAY_LIMIT_ms,
            note=f"95 %: {np.quantile(delays_ms, 0.95):.0f} ms, of {len(delays_ms)} frames",
        ),
        Figure(
            f"{AT}: sent to a page", statistics.mean(one.kB_per_s for one in seen), "kB/s",
            note=", ".join(one.lost for one in seen if one.lost) or "no ticks lost on the way",
        ),
    ]  # fmt: skip
