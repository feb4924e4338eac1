"""What `motord bridge foxglove` sends of a bench at 10 kHz, how soon, and what it costs.

A viewer that speaks the protocol by itself subscribes to every topic, as the shipped layout does.
"""

import json
import statistics
import time
from collections import Counter

from motord.foxglove import topics
from tests.benchmarks.bench_dashboard import RATE_Hz, TICK_RATE_Hz, cpu_s, operated
from tests.benchmarks.bench_isolation import running_bench
from tests.benchmarks.figure import Figure
from tests.support.foxglove_client import Viewer
from tests.system.daemons import Program

SECONDS, QUICK_S = 60.0, 5.0
MESSAGES_LIMIT_Hz = 60.0
DELAY_LIMIT_ms = 150.0
TOPICS = [topic.name for topic in topics.SERVED]
AT = f"Foxglove bridge at {RATE_Hz // 1000} kHz"


def figures(quick: bool) -> list[Figure]:
    """Return messages a second, delays from sample to viewer, and the load of the bridge."""
    with running_bench(RATE_Hz, TICK_RATE_Hz) as bench, operated(bench):
        arguments = ("--connect", bench.endpoint, "--port", 0, "--json")
        bridge = Program(bench.daemon.folder, "bridge", "foxglove", *arguments)
        try:
            with Viewer(json.loads(bridge.first_line)["url"]) as viewer:
                viewer.subscribe(*TOPICS)
                return view(viewer, bridge.process.pid, QUICK_S if quick else SECONDS)
        finally:
            bridge.close()


def view(viewer: Viewer, pid: int, seconds: float) -> list[Figure]:
    """Return what a viewer of every topic gets."""
    viewer.next_of_all()
    counts: Counter[str] = Counter()
    delays_ms = []
    before_s, begun_s = cpu_s([pid])[pid], time.monotonic()
    while time.monotonic() - begun_s < seconds:
        message = viewer.next_of_all()
        counts[message.topic] += 1
        if message.topic == "/tick":
            delays_ms.append((time.time_ns() - message.t_ns) / 1e6)
    lasted_s = time.monotonic() - begun_s
    busiest, most = counts.most_common(1)[0]
    return [
        Figure(
            f"{AT}: messages of the busiest topic", most / lasted_s, "/s", MESSAGES_LIMIT_Hz,
            note=f"{busiest}; {sum(counts.values()) / lasted_s:.0f}/s in all",
        ),
        Figure(
            f"{AT}: from sample to viewer, median", statistics.median(delays_ms), "ms",
            DELAY_LIMIT_ms, note=f"95 %: {statistics.quantiles(delays_ms, n=20)[-1]:.0f} ms",
        ),
        Figure(
            f"{AT}: processor time", 100 * (cpu_s([pid])[pid] - before_s) / lasted_s, "%"
        ),
    ]  # fmt: skip
