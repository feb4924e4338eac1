"""A recorder killed at random moments, at the rate of a real bench, reads back whole."""

import os
import signal

import numpy as np
import pytest

from motord.schema import State
from tests.benchmarks.bench_kills import MISSING_LIMIT_S, kill_often
from tests.system.daemons import daemon, wait_for, write_sim
from tests.system.test_daemon import check_ticks

pytestmark = pytest.mark.system


def test_a_recorder_killed_again_and_again_loses_nothing_that_the_ring_holds():
    outcome = kill_often(rate_Hz=1000, kills=3, seed=1)
    assert outcome.unreadable == []
    assert len(outcome.missing_s) == 3
    both = zip(outcome.missing_s, outcome.late_s, strict=True)
    assert max(missing_s - late_s for missing_s, late_s in both) <= MISSING_LIMIT_S
    assert (outcome.gone, outcome.double) == (0, 0)
    assert outcome.ticks > 1000


def test_one_that_is_killed_right_before_the_daemon_ends_loses_nothing_either(tmp_path):
    """The daemon waits for the next one, which takes the rest from the ring."""
    with daemon(tmp_path, write_sim(tmp_path)) as running, running.connect() as client:
        lease = client.lease("anna")
        lease.acquire()
        client.rpc("enable", token=lease.token)
        wait_for(client, lambda s: s.recording.path, "the recording")
        enabled = client.state()
        os.kill(enabled.processes["recorder"].pid, signal.SIGKILL)
        assert running.end() == 0
    assert "was not closed" not in running.said()
    files = running.last_recording()
    ticks = np.concatenate([file.ticks(("tick", "missed", "flags", "state")) for file in files])
    check_ticks(ticks)
    assert ticks["tick"][-1] > enabled.tick.tick
    assert State(int(ticks["state"][-1])) is State.OFF
    assert files[-1].end["reason"] == "the daemon shut down"
    assert [event["kind"] for event in files[-1].events()].count("timing") == 1
