"""A sweep whose processes are killed again and again, and that is finished all the same.

`python -m tests.campaigns.plan_kills [--kills 500] [--seed 1] [--benches 3]` runs sweeps on
simulated benches in real time, some side by side. At random moments it kills (-9) the supervisor,
the loop, the recorder or all of them, starts what does not come back by itself and resumes the
plan. The journal must be whole after every kill; at the end of a sweep the recordings must hold
every point, whole, once, and every tick but the last 1.5 s before everything was killed. What is
lost when everything is killed while a killed recorder's successor is not up yet is counted apart:
of that, nothing had been recorded.
"""

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock

import psutil

from motord.client import ClientError
from motord.service.plans.journal import read
from motord.shm.ring import RingReader
from motord.shm.run_directory import RunDir
from tests.campaigns import seeds
from tests.campaigns.plan_kills_found import MISSING_LIMIT_S, UNRECORDED, Found, Kill, look
from tests.support.patience import until
from tests.system.daemons import Daemon, kill_everything, wait_for, write_sim

PLAN = {
    "torques_Nm": [1.0, 2.0], "speeds_Hz": [1.6, 1.8, 2.0], "turns": 2, "settle_s": 0.1,
    "speed_tolerance": 0.05, "gain_steps": [],
}  # fmt: skip
POINTS = frozenset(range(6))
VICTIMS = ("everything", "supervisor", "loop", "recorder")
MEAN_S, LONGEST_S = 2.0, 8.0
PATIENT = 0.5
"""Part of the supervisor's deaths after which loop and recorder are waited for."""
LOOK_S = 0.05


@dataclass
class Outcome:
    """What a sweep has come to."""

    killed: Counter[str] = field(default_factory=Counter)
    torn: list[str] = field(default_factory=list)
    found: Found = field(default_factory=Found)

    @property
    def problems(self) -> list[str]:
        """What is not as it should be, as messages."""
        found, once = self.found, Counter(dict.fromkeys(POINTS, 1))
        return [
            *self.torn,
            *found.unreadable,
            *([f"points {dict(found.points)}"] if found.points != once else []),
            *found.gone,
            *([f"{found.double} ticks twice"] if found.double else []),
            *(
                f"{late_s:.2f} s missing after {victim} was killed"
                for victim, late_s in found.missing_s
                if late_s > MISSING_LIMIT_S  # nobody recorded it, but the ring outlived them
            ),
            *(
                f"{late_s:.2f} s missing when {victim} was killed"
                for victim, late_s in found.missing_then_s
                if late_s > MISSING_LIMIT_S and UNRECORDED not in victim
            ),
        ]


class Sweep:
    """One plan from its start to its end, over as many daemons as it takes."""

    def __init__(self, folder: Path, kills: int, rng: random.Random) -> None:
        self.folder, self.rng, self.kills_left = folder, rng, kills
        self.bench = write_sim(folder)
        always = '\n[recording]\nauto = "always"\n'  # so that no tick may be missing in between
        self.bench.write_text(self.bench.read_text() + always)
        self.run_dir = RunDir(self.bench.stem, folder / "motord")
        self.outcome = Outcome()
        self.kills: list[Kill] = []
        self.started = False

    def run(self) -> Outcome:
        """Kill and resume until nothing is missing; return what came of it."""
        while not self._one_daemon():
            continue
        self.outcome.found = look(self.folder / "runs", self.kills)
        return self.outcome

    def _one_daemon(self) -> bool:
        """Run a daemon until the sweep is finished (True) or the daemon is killed."""
        daemon = Daemon(self.folder, self.bench)
        try:
            with daemon.connect() as client:
                while self._go_on(client):
                    if self._killed_within(daemon, client):
                        return False
                    state = client.state()
                    if state.fault or state.state == "TRIPPED":
                        _command(client, "reset")
                wait_for(
                    client, lambda s: "calibrate" not in s.recording.path, "the next recording"
                )
            assert daemon.end() == 0
            return True
        finally:
            daemon.close()

    def _go_on(self, client) -> bool:
        """Start or resume the plan; return whether anything is under way."""
        if not self.started:
            _command(client, "plan/start", name="calibrate", settings=PLAN, detach=True)
            self.started = True
            return True
        try:
            return _command(client, "plan/resume", detach=True)["state"] != "done"
        except ClientError as error:
            if "none was interrupted" in str(error):
                return False
            raise

    def _killed_within(self, daemon, client) -> bool:
        """Wait for the plan to be over, killing something meanwhile; True if the daemon is gone."""
        kill_s = self._next_kill_s()
        while not client.plan().over:
            if self.kills_left and time.monotonic() >= kill_s:
                if self._kill(self.rng.choice(VICTIMS), daemon, client):
                    return True
                kill_s = self._next_kill_s()
            time.sleep(LOOK_S)
        return False

    def _next_kill_s(self) -> float:
        return time.monotonic() + min(self.rng.expovariate(1 / MEAN_S), LONGEST_S)

    def _kill(self, victim: str, daemon, client) -> bool:
        """Kill a process, if it runs, or all; return whether the daemon is gone."""
        state = client.state()
        pids = {name: view.pid for name, view in state.processes.items() if view.pid}
        fatal = victim in ("everything", "supervisor")
        if not fatal and victim not in pids:
            return False
        if victim == "everything":
            kill_everything(daemon, client)
        elif victim == "supervisor":
            assert daemon.end(signal.SIGKILL) == -signal.SIGKILL
            if self.rng.random() < PATIENT:  # else the next daemon is started while they live
                until(
                    lambda: not any(map(psutil.pid_exists, pids.values())),
                    "loop and recorder to end",
                )
        else:
            os.kill(pids[victim], signal.SIGKILL)
        self.kills_left -= 1
        self.outcome.killed[victim] += 1
        self._note(victim if state.recording.recording else victim + UNRECORDED)
        return fatal

    def _note(self, victim: str) -> None:
        """Keep what there was when a process had been killed; look at the journal."""
        block, _ = RingReader(self.run_dir.ring, "oldest").read()
        if len(block):
            files = frozenset(path.name for path in (self.folder / "runs").glob("*.mcap*"))
            self.kills.append(Kill(victim, int(block["t_ns"][-1]), files))
        [journal] = (self.folder / "state").rglob(f"{self.bench.stem}.jsonl")
        content = journal.read_bytes()
        parsed = read(content)
        if parsed.log is None or parsed.size != len(content):
            self.outcome.torn.append(f"journal torn after {victim} was killed")


def _command(client, request: str, /, **arguments):
    """Carry out a request in command; once more where a busy computer let the lease run out."""
    for last in (False, True):
        try:
            with client.lease("campaign", force=True) as lease:
                return client.rpc(request, token=lease.token, **arguments)
        except ClientError as error:
            if error.code != "no_lease" or last:
                raise
    raise AssertionError("the loop returns or raises")


class Campaign:
    """Sweeps until there were so many kills, by several threads with a bench each."""

    def __init__(self, kills: int, per_sweep: int) -> None:
        self._left, self._per_sweep, self._lock = kills, per_sweep, Lock()
        self.outcomes: list[Outcome] = []
        self._begun_s = time.monotonic()

    def sweeps(self, seed: str) -> None:
        """Run sweeps on one bench."""
        rng = random.Random(seed)
        for kills in self._shares():
            with tempfile.TemporaryDirectory(prefix="motord-kills-") as name:
                sweep = Sweep(Path(name), kills, rng)
                outcome = sweep.run()
            with self._lock:
                self._left += sweep.kills_left
                self.outcomes.append(outcome)
                self._report(outcome)

    def _shares(self) -> Iterator[int]:
        """Yield how many kills the next sweep may have, as long as any are left."""
        while True:
            with self._lock:
                share = min(self._left, self._per_sweep)
                self._left -= share
            if not share:
                return
            yield share

    def _report(self, outcome: Outcome) -> None:
        kills = sum(sum(each.killed.values()) for each in self.outcomes)
        sys.stdout.write(
            f"{'BAD' if outcome.problems else 'ok '} killed {dict(outcome.killed)} "
            f"{'; '.join(outcome.problems)}; {kills} kills in all, "
            f"{(time.monotonic() - self._begun_s) / 60:.1f} min\n"
        )
        sys.stdout.flush()

    def summary(self) -> str:
        """Return the figures of all sweeps as text."""
        killed = sum((each.killed for each in self.outcomes), Counter())
        finds = [each.found for each in self.outcomes]
        lines = [
            f"{killed.total()} kills in {len(self.outcomes)} sweeps, {dict(killed)}; "
            f"{sum(find.ticks for find in finds)} ticks, "
            f"{sum(map(bool, (each.problems for each in self.outcomes)))} sweeps with problems"
        ]
        for name, pairs in (
            ("when the recorder died", [p for find in finds for p in find.missing_then_s]),
            ("in the end", [p for find in finds for p in find.missing_s]),
        ):
            for victim in (*VICTIMS, *(victim + UNRECORDED for victim in VICTIMS)):
                some_s = sorted(late_s for who, late_s in pairs if who == victim)
                if some_s:
                    lines.append(
                        f"missing {name}, {victim} killed: at most {some_s[-1]:.3f} s, "
                        f"median {some_s[len(some_s) // 2]:.3f} s of {len(some_s)}"
                    )
        return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--per-sweep", type=int, default=25)
    parser.add_argument("--seed", type=int, default=seeds.first())
    parser.add_argument("--benches", type=int, default=3, help="side by side")
    options = parser.parse_args()
    campaign = Campaign(options.kills, options.per_sweep)
    drawn = [f"{options.seed}.{bench}" for bench in range(options.benches)]
    with ThreadPoolExecutor(options.benches) as threads:
        list(threads.map(campaign.sweeps, drawn))
    sys.stdout.write(f"{campaign.summary()}\n")
    return 1 if any(outcome.problems for outcome in campaign.outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
