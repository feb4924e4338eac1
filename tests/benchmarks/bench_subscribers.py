"""Five subscribers to every tick at 10 kHz: what the loop feels of them, and what they lose.

The daemon runs the simulated bench. Slices with and without subscribers alternate, as in
`bench_isolation`; then all of them stay for a minute and account for every tick: received, missed
by the loop or told as lost. What is in none of these was lost silently. Meanwhile a client asks,
one request after the other, and its round trips are timed.
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
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
    Seen,
    compared,
    has_rights,
)
from tests.benchmarks.figure import Figure, number
from tests.system.daemons import daemon, write_sim

RATE_Hz = 10_000
SUBSCRIBERS = 5
STAY_S, QUICK_STAY_S = 60.0, 4.0
ROUND_TRIP_LIMIT_ms = 5.0
PAUSE_S = 0.005
"""Between two requests, so that they come at any time of the supervisor's step."""

SUBSCRIBER = """
import json, sys
from motord.client import connect

with connect(sys.argv[1], sys.argv[2]) as client:
    print("up", flush=True)
    while sys.stdin.readline():
        received, ends = [0], []

        def count(block):
            received[0] += len(block)
            ends[1:] = [int(block["tick"][-1])]
            if len(ends) == 1:
                ends.insert(0, int(block["tick"][0]))

        ticks = client.subscribe_ticks(count)
        print("on", flush=True)
        sys.stdin.readline()
        ticks.close()
        print(json.dumps([received[0], *ticks.losses, ends]), flush=True)
"""
"""Subscribes at one line on stdin, ends it at the next and says what came and what did not."""


@dataclass(frozen=True)
class Account:
    """What one subscriber received, was told of, and had between its first and its last tick."""

    received: int
    lost: int
    missed: int
    restarts: int
    span: int

    @property
    def silent(self) -> int:
        """Ticks that are in no account."""
        return self.span - self.received - self.lost - self.missed


class Subscriber:
    """A process that subscribes when it is told to."""

    def __init__(self, bench: str, endpoint: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", SUBSCRIBER, bench, endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._says() == "up\n"

    def __enter__(self) -> "Subscriber":
        return self

    def __exit__(self, *error: object) -> None:
        self.process.kill()
        self.process.communicate()

    def begin(self) -> None:
        """Subscribe."""
        self._tell()
        assert self._says() == "on\n"

    def end(self) -> Account:
        """End the subscription and return its account."""
        self._tell()
        received, lost, missed, restarts, ends = json.loads(self._says())
        span = ends[-1] - ends[0] + 1 if ends else 0
        return Account(received, lost, missed, restarts, span)

    def _tell(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()

    def _says(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()


@contextmanager
def running_bench() -> Iterator[Bench]:
    """Run the simulated bench at RATE_Hz with its loop on the last processor."""
    cpu = choose_cpu(config.load().loop).cpu
    assert cpu is not None
    with tempfile.TemporaryDirectory() as name:
        path = write_sim(Path(name), "subscribers")
        text = path.read_text().replace("rate_Hz = 500", f"rate_Hz = {RATE_Hz}\ncpu = {cpu}")
        path.write_text(text.replace("overrun_ticks = 500", f"overrun_ticks = {RATE_Hz}"))
        with daemon(Path(name), path) as running:
            yield Bench(running, cpu)


def round_trips_ms(client: Client, seconds: float) -> list[float]:
    """Return how long requests took that were made one after the other."""
    found, end_s = [], time.monotonic() + seconds
    while time.monotonic() < end_s:
        begun_s = time.perf_counter()
        client.rpc("plan/list")
        found.append(1e3 * (time.perf_counter() - begun_s))
        time.sleep(PAUSE_S)
    return found


def stay(
    client: Client, subscribers: list[Subscriber], seconds: float
) -> tuple[list[Account], list[float]]:
    """Return what each subscriber got in so many seconds, and the round trips meanwhile."""
    for each in subscribers:
        each.begin()
    trips_ms = round_trips_ms(client, seconds)
    return [each.end() for each in subscribers], trips_ms


def figures(quick: bool) -> list[Figure]:
    """Return what the loop feels of subscribers, what they lose, and the round trip of requests."""
    with ExitStack() as stack:
        bench = stack.enter_context(running_bench())
        client = cast(Client, stack.enter_context(bench.daemon.connect()))
        subscribers = [
            stack.enter_context(Subscriber(bench.name, bench.endpoint)) for _ in range(SUBSCRIBERS)
        ]
        alone_ms = round_trips_ms(client, QUICK_S)
        rights = has_rights(bench)
        disturbance = Disturbance(
            f"{SUBSCRIBERS} subscribers at 10 kHz",
            lambda: [each.begin() for each in subscribers],
            lambda: [each.end() for each in subscribers],
        )
        quiet, disturbed = (
            bench.compare(disturbance, QUICK_S if quick else SECONDS)
            if rights
            else (Seen(), Seen())
        )
        accounts, with_ms = stay(client, subscribers, QUICK_STAY_S if quick else STAY_S)
    return [
        *compared(disturbance.name, quiet, disturbed, rights),
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
    """Return the ticks that subscribers lost silently, and those that they were told of."""
    received = sum(each.received for each in accounts)
    missed = max(each.missed for each in accounts)
    return [
        Figure(
            "ticks lost silently by all subscribers",
            sum(abs(each.silent) for each in accounts),
            bound=0,
            note=f"{received} received; the loop missed {missed}",
        ),
        Figure("ticks lost and told", sum(each.lost for each in accounts)),
    ]
