"""The queue of a daemon: policies for failures, and kill -9 while a plan runs."""

import json
import os
import signal

import pytest
from typer.testing import CliRunner

from motord.cli import app
from tests.support.patience import until
from tests.system.daemons import daemon, journal, runtime_of, wait_for, write_sim

pytestmark = [pytest.mark.system, pytest.mark.slow]

FILE = """
[[plan]]
name = "cogging"
settings = {{speeds_Hz = [1.0], turns = 2, settle_s = 0.2, spin_up = 1.0}}

[[plan]]
name = "calibrate"
settings = {{torques_Nm = [1.0], speeds_Hz = [1.0], turns = 2, settle_timeout_s = 0.01}}
on_failure = "{policy}"

[[plan]]
name = "cogging"
settings = {{speeds_Hz = [1.0], turns = {turns}, settle_s = 0.2, spin_up = 1.0}}
"""


@pytest.fixture
def motord(tmp_path):
    """Run a command line and return its exit code, JSON and stderr."""

    def run(running, *arguments):
        with runtime_of(tmp_path):
            where = ["--connect", running.endpoint, "--json"]
            found = CliRunner().invoke(app, ["queue", *map(str, arguments), *where])
        return found.exit_code, json.loads(found.stdout or "null"), found.stderr

    return run


def write(folder, policy, turns=2):
    path = folder / "queue.toml"
    path.write_text(FILE.format(policy=policy, turns=turns))
    return path


def runs(queue):
    return [(run["id"], run["state"], run["kept"]) for run in queue["history"]]


def test_three_plans_of_which_one_fails_with_each_policy_then_kill_9(tmp_path, motord):
    path = write_sim(tmp_path)
    with daemon(tmp_path, path) as first, first.connect() as client:
        bad = tmp_path / "bad.toml"
        bad.write_text(FILE.format(policy="perhaps", turns=2))
        code, _, said = motord(first, "add", "--file", bad)
        assert code == 1
        assert f"{bad}:9: plan[1].on_failure" in said
        assert motord(first, "add", "--file", write(tmp_path, "stop"))[1]["added"] == [1, 2, 3]
        code, queue, said = motord(first, "start")
        assert (code, runs(queue)) == (1, [(1, "done", False), (2, "failed", True)])
        assert "the queue is paused: 2 (calibrate) failed: " in said
        motord(first, "remove", 2, 3)
        motord(first, "add", "--file", write(tmp_path, "skip"))
        motord(first, "remove", 4)
        code, queue, said = motord(first, "start")
        assert code == 1
        assert "the queue is empty; 1 runs have failed" in said
        assert runs(queue)[2:] == [(5, "failed", False), (6, "done", False)]
        motord(first, "add", "--file", write(tmp_path, "retry", turns=1000))
        queue = motord(first, "move", 9, 1)[1]
        assert [item["id"] for item in queue["items"]] == [9, 7, 8]
        code, queue, _ = motord(first, "start", "--detach")
        assert (code, queue["queue"]["detached"]) == (0, True)
        wait_for(client, lambda s: s.plan.state == "running" and s.plan.step, "the plan")
        state = wait_for(client, lambda s: s.queue.state == "running", "the queue")
        assert (state.queue.running, state.queue.next, state.lease.holder) == (
            9, 7, "plan cogging"
        )  # fmt: skip
        run_id = client.plan().run_id
        until(lambda: run_id in journal(tmp_path), "the journal to be on the disk")
        pids = [view.pid for view in client.state().processes.values() if view.pid]
        assert first.end(signal.SIGKILL) == -signal.SIGKILL
    with daemon(tmp_path, path) as second, second.connect() as client:
        state = client.state()
        assert (state.queue.state, state.queue.length, state.state) == ("paused", 3, "OFF")
        until(lambda: not any(map(alive, pids)), "the old loop and recorder to end")
        queue = motord(second, "list")[1]
        assert [(i["id"], i["state"]) for i in queue["items"]] == [
            (9, "interrupted"), (7, "queued"), (8, "queued")
        ]  # fmt: skip
        run_id = queue["items"][0]["run_id"]
        assert run_id == client.plan().run_id
        motord(second, "start", "--detach")
        wait_for(client, lambda s: s.queue.running == 9 and not s.plan.over, "the rest")
        assert client.plan().run_id == run_id
        assert client.plan().continues
        client.stop()
        state = wait_for(client, lambda s: s.queue.running is None, "the queue to be paused")
        assert (state.queue.state, state.queue.length) == ("paused", 3)
        queue = motord(second, "pause", "--now")[1]
        assert queue["history"][-1]["state"] == "aborted"
        assert second.end() == 0


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
