"""What the loop feels of a plan's estimator at 5 kHz, and how much of a processor that takes.

The daemon runs the simulated bench and calibrates it to targets, again and again: in one run of
each pair the estimator process is killed as the plan begins, and the plan goes on without. Slices
are taken and pairs compared as in `bench_isolation`, while the plan captures.
"""

import os
import signal
from pathlib import Path

from motord.api.messages import BenchState
from motord.client import Client
from tests.benchmarks.bench_isolation import Bench, has_rights
from tests.benchmarks.bench_subscribers import running_bench
from tests.benchmarks.figure import Figure
from tests.benchmarks.paired import Pair, Seen, compared, heartbeat
from tests.system.daemons import wait_for

RATE_Hz = 5000
RUNS, QUICK_RUNS = 6, 1
TARGETS = {"alpha_percent": 0.1, "beta_A": 0.02, "cogging_percent": 1.0}
SHARE_LIMIT_PERCENT = 20.0
MISSED_LIMIT = 0
CLOCK_Hz = os.sysconf("SC_CLK_TCK")


def processor_s(pid: int) -> float:
    """Return the processor time that a process has taken, its threads included."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / CLOCK_Hz


def estimator(state: BenchState) -> int | None:
    """Return the number of the estimator process, if there is one."""
    view = state.processes.get("estimator")
    return view.pid if view else None


class Runs:
    """Plans with and without the estimator: their slices, ticks missed, processor time."""

    def __init__(self, bench: Bench, client: Client) -> None:
        self._bench, self._client = bench, client
        self.pairs: list[Pair] = []
        self.missed = {True: 0, False: 0}
        self.used_s = self.lasted_s = 0.0

    def run_pair(self) -> None:
        """Calibrate with and without the estimator, in the other order than the time before."""
        if len(self.pairs) % 2 == 0:
            self.pairs.append(Pair(quiet=self._run(), disturbed=self._run(estimated=True)))
        else:
            self.pairs.append(Pair(disturbed=self._run(estimated=True), quiet=self._run()))

    def _run(self, *, estimated: bool = False) -> Seen:
        """Calibrate once and return what the loop counted meanwhile."""
        client, used_s, seen = self._client, 0.0, Seen()
        missed = client.state().loop.missed
        with client.lease("benchmark") as lease:
            lease.start_plan("calibrate", TARGETS, detach=True)
            state = wait_for(client, estimator, "the estimator")
            pid, begun_ns = estimator(state), state.t_ns
            if not estimated:
                os.kill(pid, signal.SIGKILL)
            while True:
                self._bench.take(seen)
                plan = client.plan()
                if plan is None or plan.over:
                    break
                used_s = processor_s(pid) if estimated else 0.0
        if estimated:
            self.used_s += used_s
            self.lasted_s += 1e-9 * (client.state().t_ns - begun_ns)
        self.missed[estimated] += client.state().loop.missed - missed
        return seen

    def figures(self) -> list[Figure]:
        """Return p99 with to without the estimator, its share, ticks missed."""
        rights = has_rights(self._bench)
        share_percent = 100 * self.used_s / self.lasted_s
        note = f"{self.used_s:.1f} s in {self.lasted_s:.0f} s of plans"
        without = f"{self.missed[False]} without"
        return [
            *compared("estimator", self.pairs, rights),
            heartbeat("estimator", self.pairs, rights),
            Figure("estimator: of a processor", share_percent, "%", SHARE_LIMIT_PERCENT, note=note),
            Figure("estimator: ticks missed", self.missed[True], note=without),
        ]


def figures(quick: bool) -> list[Figure]:
    """Return what the loop feels of the estimator, and what that takes."""
    with running_bench(RATE_Hz) as bench, bench.daemon.connect() as client:
        runs = Runs(bench, client)
        for _ in range(QUICK_RUNS if quick else RUNS):
            runs.run_pair()
        return runs.figures()
