"""What goes wrong around the loop does not reach it: every tick is there, and once."""

import os
import re
import signal
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from motord.recording.reader import open_run
from motord.schema import State
from motord.shm.ring import RingReader
from motord.shm.run_directory import RunDir
from tests.support.patience import until
from tests.system.daemons import daemon, wait_for, write_sim
from tests.system.disturbances import (
    hogs,
    seen_by,
    small_disk,
    small_disks_can_be_had,
    unsent_bytes,
)
from tests.system.test_daemon import check_ticks
from tests.system.tick_accounts import Subscriber

pytestmark = [pytest.mark.system, pytest.mark.slow]

RATE_HZ = 2000
RING_S = 100.0
TICKS = 2400
"""How many ticks are awaited while something is wrong: longer than the loop waits for a supervisor
(`STALE_S`)."""
FULL_BYTES = 100_000
"""Unread telemetry: far more than the subscriber itself has room for."""
ROOM_BYTES = 16384

needs_mount = pytest.mark.skipif(
    not small_disks_can_be_had(), reason="this user may not mount in a namespace of its own"
)


def write_bench(folder, recording=""):
    """Write a bench with a ring so long that it holds a whole test."""
    path = write_sim(folder, "isolated")
    text = path.read_text().replace("rate_Hz = 500", f"rate_Hz = {RATE_HZ}")
    text = re.sub(r"^ring_s = .*$", f"ring_s = {RING_S}", text, flags=re.MULTILINE)
    text = text.replace("\nlease_s =", "\ntick_rate_Hz = 1000.0\nlease_s =")
    path.write_text(f"{text}\n[recording]\n{recording}\n")
    return path


class Bench:
    """An enabled bench, and a reader of its ring that sees what the loop publishes."""

    def __init__(self, running, client):
        self.daemon = running
        self.client = client
        run_dir = RunDir(running.config.bench.name, running.folder / "motord")
        self._ring = RingReader(run_dir.ring, "oldest")
        self._blocks = []

    def pid(self, name):
        return self.client.state().processes[name].pid

    def look(self):
        """Take in the ticks that have come; none may have been overwritten."""
        block, lost = self._ring.read()
        assert lost == 0
        self._blocks.append(block)

    @property
    def ticks(self):
        self.look()
        self._blocks = [np.concatenate(self._blocks)]
        return self._blocks[0]

    def go_on(self, ticks=TICKS):
        """Wait for so many more ticks; the bench must stay enabled."""
        last = int(self.ticks["tick"][-1]) + ticks
        until(lambda: self.ticks["tick"][-1] >= last, f"tick {last}")
        state = self.client.state()
        assert state.state == "ENABLED", state.trips

    def end(self):
        """End the daemon; return all that the loop has published."""
        assert self.daemon.end() == 0, self.daemon.said()
        published = self.ticks
        check_ticks(published)
        return published


@contextmanager
def enabled(folder, path, before=()):
    with daemon(folder, path, before) as running, running.connect() as client:
        lease = client.lease("anna")
        lease.acquire()
        client.rpc("enable", token=lease.token)
        wait_for(client, lambda s: s.recording.recording, "a recording")
        client.rpc("set", token=lease.token, torque_Nm=1.0, speed_Hz=0.7)
        yield Bench(running, client)


def same(recorded, published):
    """Whether the ticks that were recorded are those published at these numbers, to the bit."""
    first = np.searchsorted(published["tick"], recorded["tick"][0])
    there = published[first : first + len(recorded)]
    return all(recorded[name].tobytes() == there[name].tobytes() for name in recorded.dtype.names)


def check_recorded_to_the_end(bench):
    """End the bench: all ticks since the recording began are in its files, each once."""
    published = bench.end()
    runs = bench.daemon.runs()
    recorded = np.concatenate([run.ticks() for run in runs])
    check_ticks(recorded)
    assert recorded["tick"][-1] == published["tick"][-1]
    assert same(recorded, published)
    assert not any(event["kind"] == "ring_lost" for run in runs for event in run.events())
    kinds = [event["kind"] for event in runs[-1].events()]
    assert "daemon" in kinds
    assert kinds.count("timing") == 1
    return runs


def test_a_subscriber_that_stands_still_hogs_and_a_recorder_killed_again_and_again(tmp_path):
    """The last time right before the daemon ends."""
    with enabled(tmp_path, write_bench(tmp_path)) as bench:
        recording = bench.client.state().recording
        assert recording.path == f"{recording.final_path}.part"
        assert Path(recording.path).exists()
        stop_a_subscriber(bench)
        with hogs():
            bench.go_on()
        kill_the_recorder(bench, times=2)
        said = [event for event in bench.client.events() if "recorder ended" in event.message]
        assert len(said) == 2
        os.kill(bench.pid("recorder"), signal.SIGKILL)  # the daemon waits for the next one
        runs = check_recorded_to_the_end(bench)
    assert len(runs) == 4
    assert "was not closed" not in bench.daemon.said()
    assert runs[-1].end["reason"] == "the daemon shut down"
    assert State(int(runs[-1].ticks(("state",))["state"][-1])) is State.OFF
    assert not (tmp_path / "runs" / "blackbox").exists()
    for before, after in pairwise(runs):
        [restart] = [e["data"] for e in after.events() if e["kind"] == "recorder_restarted"]
        assert restart["tick_before"] == before.ticks(("tick",))["tick"][-1]
        assert restart["tick_after"] == after.ticks(("tick",))["tick"][0]
        assert restart["lost"] == 0


def stop_a_subscriber(bench):
    """Others get all; what the one that stands still loses is reported to it."""
    name, endpoint, streamed = bench.daemon.config.bench.name, bench.daemon.endpoint, []
    with (
        Subscriber(name, endpoint, ROOM_BYTES) as stopped,
        bench.client.subscribe_ticks(lambda block: streamed.append(int(block["tick"][-1]))),
        bench.client.subscribe_ticks(kept=2) as slow,
    ):
        stopped.begin()
        read = [slow.get()]
        stopped.process.send_signal(signal.SIGSTOP)
        until(lambda: unsent_bytes(endpoint) > FULL_BYTES, "the stopped one's link to be full")
        before = bench.client.state()
        bench.go_on()
        last = int(bench.ticks["tick"][-1])
        until(lambda: streamed[-1] >= last, "the other subscriber to get all")
        after = bench.client.state()
        assert after.loop.lost_by_supervisor == before.loop.lost_by_supervisor
        assert after.telemetry_dropped == 0
        read += [slow.get(), slow.get()]
        span = int(read[-1]["tick"][-1]) - int(read[0]["tick"][0]) + 1
        assert slow.losses.lost_ticks > 0
        assert sum(map(len, read)) + slow.lost_ticks + slow.losses.missed_ticks == span
        stopped.process.send_signal(signal.SIGCONT)
        until(lambda: unsent_bytes(endpoint) == 0, "the stopped one to read")
        account = stopped.end()
        assert account.received > 0
        assert account.silent == 0  # what the buffers on the way did not hold is reported as lost


def kill_the_recorder(bench, times):
    for number in range(1, times + 1):
        bench.go_on(TICKS // 3)
        os.kill(bench.pid("recorder"), signal.SIGKILL)
        wait_for(
            bench.client,
            lambda s, n=number: s.processes["recorder"].restarts == n and s.recording.recording,
            f"recorder {number + 1}",
        )
    bench.go_on(TICKS // 3)


@needs_mount
@pytest.mark.parametrize("free_min_MB", [2, 0], ids=["guarded", "to the last byte"])
def test_a_disk_that_runs_full(tmp_path, free_min_MB):
    folder = tmp_path / "runs"
    folder.mkdir()
    recording = f'compression = "none"\nfree_min_MB = {free_min_MB}'
    before = small_disk(folder, free_min_MB + 2)
    with enabled(tmp_path, write_bench(tmp_path, recording), before) as bench:
        state = wait_for(bench.client, lambda s: s.recording.error, "the disk to be full")
        bench.go_on()
        assert bench.client.state().processes["recorder"].restarts == 0
        [path] = seen_by(bench.daemon.process, folder).glob("*.mcap*")
        run = open_run(path)
        if free_min_MB:
            assert "free_min_MB" in state.recording.error
            assert (path.suffix, run.check()) == (".mcap", None)
            assert any(event["kind"] == "recording_ended" for event in run.events())
        else:
            assert "No space left" in state.recording.error
            assert path.suffix == ".part"
        check_recorded_until_it_ended(bench, run)


def check_recorded_until_it_ended(bench, run):
    """End the bench: the file has all ticks up to where it ends; the loop went on after it."""
    recorded, events = run.ticks(), bench.client.events()
    assert len(recorded) > TICKS // 5
    assert any("the recorder says" in event.message for event in events)
    published = bench.end()
    check_ticks(recorded)
    assert same(recorded, published)
    assert published["tick"][-1] >= recorded["tick"][-1] + TICKS
