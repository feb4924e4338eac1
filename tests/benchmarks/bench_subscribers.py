"""Five subscribers to every tick at 10 kHz: what the loop feels of them, and what they lose.

The daemon runs the simulated bench. Slices with and without subscribers alternate, as in
`bench_isolation`; then all of them stay for a minute and account for every tick: received, missed
by the loop or reported as lost. What is in none of these was lost silently. Meanwhile a client
asks, one request after the other, and its round trips are timed.
"""

import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import cast

from motord import config
from motord.client import Client
from motord.loop.latency.measurement import choose_cpu
from tests.benchmarks.bench_isolation import (
    QUICK_S,
    SECONDS,
    Bench,
    Disturbance,
    has_rights,
)
from tests.benchmarks.figure import Figure, number
from tests.benchmarks.paired import compared, heartbeat
from tests.system.daemons import daemon, write_sim
from tests.system.tick_accounts import Account, Subscriber

RATE_Hz = 10_000
SUBSCRIBERS = 5
STAY_S, QUICK_STAY_S = 60.0, 4.0
ROUND_TRIP_LIMIT_ms = 5.0
PAUSE_S = 0.005
"""Between two requests, so that they come at any time of the supervisor's step."""


@contextmanager
def running_bench(rate_Hz: int = RATE_Hz) -> Iterator[Bench]:
    """Run the simulated bench at `rate_Hz` with its loop on the last processor."""
    cpu = choose_cpu(config.load().loop).cpu
    assert cpu is not None
    with tempfile.TemporaryDirectory() as name:
        path = write_sim(Path(name), "subscribers")
        text = path.read_text().replace("rate_Hz = 500", f"rate_Hz = {rate_Hz}\ncpu = {cpu}")
        path.write_text(text.replace("overrun_ticks = 500", f"overrun_ticks = {rate_Hz}"))
        with daemon(Path(name), path) as running:
            yield Bench(running, cpu)


def round_trips_ms(
    request: Callable[[], object], seconds: float, pause_s: float = PAUSE_S
) -> list[float]:
    """Return how long requests took that were made one after the other."""
    found, end_s = [], time.monotonic() + seconds
    while time.monotonic() < end_s:
        begun_s = time.perf_counter()
        request()
        found.append(1e3 * (time.perf_counter() - begun_s))
        time.sleep(pause_s)
    return found


def stay(
    request: Callable[[], object],
    subscribers: list[Subscriber],
    seconds: float,
    pause_s: float = PAUSE_S,
) -> tuple[list[Account], list[float]]:
    """Return what each subscriber got in so many seconds, and the round trips meanwhile."""
    for each in subscribers:
        each.begin()
    trips_ms = round_trips_ms(request, seconds, pause_s)
    return [each.end() for each in subscribers], trips_ms


def figures(quick: bool) -> list[Figure]:
    """Return what the loop feels of subscribers, what they lose, and the round trip of requests."""
    with ExitStack() as stack:
        bench = stack.enter_context(running_bench())
        client = cast(Client, stack.enter_context(bench.daemon.connect()))
        subscribers = [
            stack.enter_context(Subscriber(bench.name, bench.endpoint)) for _ in range(SUBSCRIBERS)
        ]

        def request() -> object:
            return client.rpc("plan/list")

        alone_ms = round_trips_ms(request, QUICK_S)
        rights = has_rights(bench)
        disturbance = Disturbance(
            f"{SUBSCRIBERS} subscribers at 10 kHz",
            lambda: [each.begin() for each in subscribers],
            lambda: [each.end() for each in subscribers],
        )
        pairs = bench.compare(disturbance, QUICK_S if quick else SECONDS) if rights else []
        accounts, with_ms = stay(request, subscribers, QUICK_STAY_S if quick else STAY_S)
    return [
        *compared(disturbance.name, pairs, rights),
        heartbeat(disturbance.name, pairs, rights),
        *accounted(accounts),
        Figure(
            "round trip of a request, median",
            statistics.median(alone_ms),
            "ms",
            ROUND_TRIP_LIMIT_ms,
            note=f"{number(statistics.median(with_ms))} ms with {SUBSCRIBERS} subscribers",
        ),
    ]


def accounted(accounts: list[Account]) -> list[Figure]:
    """Return the ticks that subscribers lost silently, and those reported as lost."""
    received = sum(each.received for each in accounts)
    missed = max(each.missed for each in accounts)
    return [
        Figure(
            "ticks lost silently by all subscribers",
            sum(abs(each.silent) for each in accounts),
            bound=0,
            note=f"{received} received; the loop missed {missed}",
        ),
        Figure("ticks lost and reported", sum(each.lost for each in accounts)),
    ]
