"""Several daemons behind routers in processes of their own; what is lost when some of it ends.

Each bench has a folder of its own. `Sightings` follows all benches and notes when each comes and
goes.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager

from motord.client.benches import Benches
from tests.support.patience import PATIENCE_S, until
from tests.support.ports import free_port
from tests.system.daemons import daemon, write_sim

PLAN = {
    "torques_Nm": [0.5, 1.0], "speeds_Hz": [1.0, 1.5], "turns": 2, "settle_s": 0.1,
    "gain_steps": [],
}  # fmt: skip
ROUTER = """
import sys, zenoh
from motord.api.endpoints import router_config
session = zenoh.open(router_config([sys.argv[1]], sys.argv[2:]))
print("ready", flush=True)
sys.stdin.read()
"""


def endpoint():
    return f"tcp/127.0.0.1:{free_port()}"


class RouterProcess:
    """A Zenoh router that listens at `listen` and connects to others."""

    def __init__(self, listen, *connect):
        self.listen, self.connect = listen, connect
        self.process = subprocess.Popen(
            [sys.executable, "-c", ROUTER, listen, *connect],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        assert self.process.stdout.readline() == b"ready\n"

    def close(self):
        """Kill it; return when, monotonic s."""
        begun_s = time.monotonic()
        self.process.kill()
        self.process.wait(PATIENCE_S)
        self.process.stdin.close()
        self.process.stdout.close()
        return begun_s


class Sightings:
    """Notes when benches come and go, monotonic s, as a client at `endpoints` sees it."""

    def __init__(self, *endpoints):
        self.times = {}  # bench, it is there: when it was last seen to become so
        self._benches = Benches(endpoints)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def close(self):
        self._over.set()
        self._thread.join()
        self._benches.close()

    def there(self):
        return {entry.bench for entry in self._benches.entries() if not entry.silent}

    def _follow(self):
        before = set()
        while not self._over.is_set():
            now = {entry.bench for entry in self._benches.entries()}
            for bench in now ^ before:
                self.times[bench, bench in now] = time.monotonic()
            before = now
            self._benches.wait(0.05)

    def since(self, begun_s, bench, there):
        """Wait until a bench has come or gone after `begun_s`; return after how long, s."""
        until(lambda: self.times.get((bench, there), -1.0) >= begun_s, f"{bench}: {there}")
        return self.times[bench, there] - begun_s


@contextmanager
def running(folder, names):
    """Run a daemon for each name, in a folder of its own; gives them by name."""
    with ExitStack() as stack:
        daemons = {}
        for name in names:
            (folder / name).mkdir()
            path = write_sim(folder / name, name)
            daemons[name] = stack.enter_context(daemon(folder / name, path))
        yield daemons


def start_plan(client):
    with client.lease("anna") as lease:
        client.rpc("plan/start", token=lease.token, name="calibrate", settings=PLAN, detach=True)


def kill_supervisor(program):
    """Kill -9 of the daemon's process; its loop ramps down, its recorder closes the file."""
    begun_s = time.monotonic()
    os.kill(program.process.pid, signal.SIGKILL)
    program.wait()
    return begun_s


def motord(*words, folder):
    """Run a command in a folder and return what it prints, as JSON."""
    done = subprocess.run(
        [sys.executable, "-m", "motord", *map(str, words), "--json"], cwd=folder,
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    return json.loads(done.stdout)


def archived(folder, copies, listen):
    """Archive a bench's recordings once it is idle, verify; return names, report, verification."""
    copies.mkdir()
    words, reports = ("archive", copies, "--from", "runs", "--connect", listen), []

    def done():
        reports.append(motord(*words, folder=folder))
        return not reports[-1]["stopped"]

    until(done, "the bench to be idle")
    copied = [name for report in reports for name in report["copied"]]
    return copied, reports[-1], motord("archive", "--verify", copies, folder=folder)
