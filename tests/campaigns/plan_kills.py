"""A sweep whose processes are killed again and again, and that is finished all the same.

`python -m tests.campaigns.plan_kills [--kills 500] [--seed 1]` runs sweeps on the simulated bench
in real time. At random moments it kills (-9) the supervisor, the loop, the recorder or all of
them, starts what does not come back by itself and resumes the plan. At the end of each sweep the
recordings must hold every point, whole.
"""

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from motord.client import ClientError
from motord.record.errors import RecordError
from motord.record.reader import open_run
from tests.system.daemons import Daemon, wait_for, wait_until, write_sim
from tests.system.test_durable_plans import alive, kill_everything, points_of

PLAN = {
    "torques_Nm": [1.0, 2.0], "speeds_Hz": [0.8, 0.9, 1.0], "turns": 2, "settle_s": 0.2,
    "gain_steps": [],
}  # fmt: skip
POINTS = 6
VICTIMS = ("everything", "supervisor", "loop", "recorder")
LONGEST_S = 9.0
LOOK_S = 0.05


class Sweep:
    """One plan from its start to its end, over as many daemons as it takes."""

    def __init__(self, folder: Path, kills: int, rng: random.Random) -> None:
        self.folder, self.rng, self.kills_left = folder, rng, kills
        self.bench = write_sim(folder)
        self.killed = Counter()
        self.started = False

    def run(self) -> None:
        """Kill and resume until nothing is missing."""
        while not self._one_daemon():
            continue

    def _one_daemon(self) -> bool:
        """Run a daemon until the sweep is finished (True) or the daemon is killed."""
        daemon = Daemon(self.folder, self.bench)
        try:
            with daemon.connect() as client, client.lease("campaign") as lease:
                while self._go_on(client, lease.token):
                    if self._killed_within(daemon, client):
                        return False
                    if client.state().fault:
                        client.rpc("reset", token=lease.token)
                wait_for(
                    client, lambda s: "calibrate" not in s.recording.path, "the next recording"
                )
            assert daemon.end() == 0
            return True
        finally:
            daemon.close()

    def _go_on(self, client, token) -> bool:
        """Start or resume the plan; return whether anything is under way."""
        if not self.started:
            client.rpc("plan/start", token=token, name="calibrate", settings=PLAN, detach=True)
            self.started = True
            return True
        try:
            return client.rpc("plan/resume", token=token, detach=True)["state"] != "done"
        except ClientError as error:
            if "none was interrupted" in str(error):
                return False
            raise

    def _killed_within(self, daemon, client) -> bool:
        """Wait for the plan to be over, killing something meanwhile; True if the daemon is gone."""
        kill_s = time.monotonic() + self.rng.uniform(0.1, LONGEST_S)
        while not client.plan().over:
            if self.kills_left and time.monotonic() >= kill_s:
                self.kills_left -= 1
                victim = self.rng.choice(VICTIMS)
                self.killed[victim] += 1
                if self._kill(victim, daemon, client):
                    return True
                kill_s = time.monotonic() + self.rng.uniform(0.1, LONGEST_S)
            time.sleep(LOOK_S)
        return False

    def _kill(self, victim: str, daemon, client) -> bool:
        """Kill a process or all; return whether the daemon is gone."""
        processes = client.state().processes
        if victim == "everything":
            kill_everything(daemon, client)
            return True
        if victim == "supervisor":
            others = [view.pid for view in processes.values() if view.pid]
            assert daemon.end(signal.SIGKILL) == -signal.SIGKILL
            wait_until(lambda: not any(map(alive, others)), "loop and recorder to end")
            return True
        if processes[victim].pid:
            os.kill(processes[victim].pid, signal.SIGKILL)
        return False

    def points(self) -> Counter:
        """Return how often the recordings hold each point, whole."""
        runs = []
        for path in sorted((self.folder / "runs").glob("*calibrate*")):
            try:
                runs.append(open_run(path))
            except RecordError:
                continue  # its recorder was killed before it had written anything
        whole = 0.9 * PLAN["turns"] * 500 / max(PLAN["speeds_Hz"])
        return Counter(index for index, ticks in points_of(runs) if ticks >= whole)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--per-sweep", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng, left, bad = random.Random(options.seed), options.kills, 0
    while left > 0:
        with tempfile.TemporaryDirectory(prefix="motord-kills-") as name:
            sweep = Sweep(Path(name), min(left, options.per_sweep), rng)
            before = sweep.kills_left
            sweep.run()
            left -= max(before - sweep.kills_left, 1)
            points = sweep.points()
            good = set(points) == set(range(POINTS))
            bad += not good
            twice = sum(points.values()) - len(points)
            sys.stdout.write(
                f"{'ok ' if good else 'BAD'} killed {dict(sweep.killed)}; {len(points)} of "
                f"{POINTS} points, {twice} more than once; {left} kills left\n"
            )
            sys.stdout.flush()
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
