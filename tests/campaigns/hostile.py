"""Can a broken child, a full system or a vanished disk stop a daemon, or hold up its heartbeat?

`python -m tests.campaigns.hostile [--lines 10000] [--seed 1]`: a daemon on the simulated rig, with
a commander and powered, is attacked: random lines, lines without end and floods of good
messages in the recorder's pipe; its folder deleted, replaced and given back; files that can grow no
more; a recorder that is killed or stopped while there are no descriptors left. The heartbeat is
read out of the ring: the longest time in which no new set-point of the supervisor came to a tick,
next to that of a quiet time before. Exit 1 if it was longer than 100 ms, the bench did not stay
enabled, the daemon ended, did not record again afterwards or kept more memory.
"""

import argparse
import os
import random
import resource
import shutil
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from motord.client import Client
from motord.shm.ring import RingReader
from motord.shm.run_directory import RunDir
from tests.campaigns import seeds
from tests.support.nonsense import random_line
from tests.system.daemons import Daemon, daemon, wait_for, write_sim

GAP_LIMIT_S = 0.1
GROWTH_LIMIT_MB = 32.0
SILENT_LINKS = 60
DESCRIPTORS_LEFT = 10
QUIET_S = 10.0
SETTLE_S = 12.0
"""Longer than Zenoh keeps a link that says nothing."""


@dataclass
class Attacked:
    """The daemon under attack. The ring is followed by a thread; `gap_s` is since `mark`."""

    running: Daemon
    client: Client
    lines: int
    chance: random.Random
    gap_s: float = 0.0
    _stop: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        run_dir = RunDir(self.running.config.bench.name, self.running.folder / "motord")
        self._ring = RingReader(run_dir.ring)
        self._last: tuple[int, int] | None = None
        self._thread = threading.Thread(target=self._follow)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()

    @property
    def runs(self) -> Path:
        """The folder of recordings."""
        return self.running.folder / "runs"

    def recorder(self) -> int:
        """Return the recorder's process number."""
        state = wait_for(self.client, lambda s: s.processes["recorder"].pid, "a recorder")
        return int(state.processes["recorder"].pid)

    def recorded_again(self) -> None:
        """Wait until the bench is recorded without error."""
        wait_for(
            self.client, lambda s: s.recording.recording and not s.recording.error, "a recording"
        )

    def write(self, content: Callable[[int], bytes], count: int) -> int:
        """Put lines into the recorder's pipe, whoever is the recorder; return how many went in."""
        sent, end_s = 0, time.monotonic() + 60.0
        while sent < count and time.monotonic() < end_s:
            with suppress(OSError), Path(f"/proc/{self.recorder()}/fd/1").open("wb", 0) as pipe:
                while sent < count:
                    pipe.write(content(sent))
                    sent += 1
        return sent

    def _follow(self) -> None:
        while not self._stop.wait(0.5):
            block, _ = self._ring.read()
            fresh = np.flatnonzero(np.diff(block["setpoint_seq"].astype(np.int64))) + 1
            for row in fresh:
                tick = block[row]
                now = int(tick["t_ns"]), int(tick["setpoint_seq"])
                if self._last is not None:
                    self.gap_s = max(self.gap_s, (now[0] - self._last[0]) / 1e9)
                self._last = now


def quiet(bench: Attacked) -> str:
    """Nothing happens."""
    time.sleep(QUIET_S)
    return f"{QUIET_S:g} s"


def random_lines(bench: Attacked) -> str:
    """Random bytes, deep JSON, huge numbers, JSON of wrong types."""
    sent = bench.write(lambda n: random_line(bench.chance) + b"\n", bench.lines)
    return f"{sent} lines"


def endless_line(bench: Attacked) -> str:
    """Bytes without a newline."""
    sent = bench.write(lambda n: b"x" * 65_536, 500)
    return f"{sent * 65_536 / 1e6:.0f} MB"


def good_messages(bench: Attacked) -> str:
    """Reports as they should be, but far too many."""
    sent = bench.write(lambda n: b'{"recording":true,"ticks":%d}\n' % n, bench.lines)
    return f"{sent} reports"


def folder_deleted(bench: Attacked) -> str:
    """The folder of recordings is removed and something else takes its place; then it is back."""
    shutil.rmtree(bench.runs)
    bench.runs.write_text("in the way")
    state = wait_for(bench.client, lambda s: s.recording.error, "the error")
    assert not state.recording.recording
    time.sleep(3.0)
    bench.runs.unlink()
    return state.recording.error.partition(": ")[2][:60]


def folder_deleted_twice(bench: Attacked) -> str:
    """The folder is removed, and removed again."""
    for _ in range(2):
        bench.recorded_again()
        shutil.rmtree(bench.runs)
        wait_for(bench.client, lambda s: s.recording.error, "the error")
    return "2 times"


def disk_full(bench: Attacked) -> str:
    """No file may grow any more; then the recorder is killed, and the next one may write."""
    pid = bench.recorder()
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (1000, 1000))
    state = wait_for(bench.client, lambda s: s.recording.error, "the error")
    os.kill(pid, signal.SIGKILL)
    return state.recording.error.partition(": ")[2][:60]


def no_descriptors(bench: Attacked) -> str:
    """Silent connections take all descriptors; meanwhile the recorder is killed, three times."""
    pid, port = bench.running.process.pid, int(bench.running.endpoint.rpartition(":")[2])
    used = len(list(Path(f"/proc/{pid}/fd").iterdir()))
    soft, hard = resource.prlimit(pid, resource.RLIMIT_NOFILE)
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (used + DESCRIPTORS_LEFT, hard))
    links = [socket.create_connection(("127.0.0.1", port), 2.0) for _ in range(SILENT_LINKS)]
    try:
        for _ in range(3):
            time.sleep(1.0)
            os.kill(bench.recorder(), signal.SIGKILL)
            time.sleep(1.0)
    finally:
        for link in links:
            link.close()
        resource.prlimit(pid, resource.RLIMIT_NOFILE, (soft, hard))
    return f"{used} + {DESCRIPTORS_LEFT}, {SILENT_LINKS} links"


def stopped(bench: Attacked) -> str:
    """The recorder stands still for a while."""
    pid = bench.recorder()
    os.kill(pid, signal.SIGSTOP)
    time.sleep(3.0)
    os.kill(pid, signal.SIGCONT)
    return "3 s"


ATTACKS = (
    quiet, random_lines, endless_line, good_messages, folder_deleted, folder_deleted_twice,
    disk_full, no_descriptors, stopped,
)  # fmt: skip


def memory_MB(pid: int) -> float:
    """Return the resident memory of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def attack(running: Daemon, lines: int, seed: int) -> list[str]:
    """Carry out all attacks; print a line for each, return what is wrong."""
    wrong: list[str] = []
    with running.connect() as client, client.lease("campaign") as lease:
        client.rpc("enable", token=lease.token)
        client.rpc("set", token=lease.token, torque_Nm=1.0, brake=1.0)
        bench = Attacked(running, client, lines, random.Random(seed))
        bench.recorded_again()
        before_MB = memory_MB(running.process.pid)
        try:
            for one in ATTACKS:
                bench.gap_s = 0.0
                what = one(bench)
                time.sleep(1.0)
                state, gap_s = client.state(), bench.gap_s
                gap = f"gap {gap_s * 1e3:5.0f} ms"
                print(f"{one.__name__:22} {what:62} {gap}, {state.state}", flush=True)
                if one is not quiet and gap_s > GAP_LIMIT_S:
                    wrong.append(f"{one.__name__}: no heartbeat for {gap_s * 1e3:.0f} ms")
                if state.state != "ENABLED" or running.process.poll() is not None:
                    return [*wrong, f"{one.__name__}: {state.state}, {state.trips}"]
                bench.recorded_again()
        finally:
            bench.close()
        time.sleep(SETTLE_S)
        wrong += _afterwards(client.state(), memory_MB(running.process.pid) - before_MB)
    return wrong


def _afterwards(state: Any, growth_MB: float) -> list[str]:
    recorder = state.processes["recorder"]
    print(
        f"recorder: {recorder.restarts} restarts, {recorder.bad_messages} bad messages, "
        f"faults {state.faults or 'none'}, memory {growth_MB:+.1f} MB"
    )
    wrong = [f"memory grew by {growth_MB:.0f} MB"] if growth_MB > GROWTH_LIMIT_MB else []
    return wrong + [f"left: {state.faults}"] * bool(state.faults)


def main() -> int:
    """Run the campaign; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--lines", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=seeds.first())
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with daemon(folder, write_sim(folder, "hostile")) as running:
            wrong = attack(running, options.lines, options.seed)
            if running.end() != 0:
                wrong.append(f"the daemon ended with {running.process.returncode}")
    print("\n".join(wrong) if wrong else "all bounds kept")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
