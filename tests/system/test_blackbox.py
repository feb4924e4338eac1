"""What is left of a trip when nobody was recording, and of processes that were killed.

Commands of a daemon that is killed end, each with a line.
"""

import json
import signal
import subprocess

import numpy as np
import pytest

from motord.client import ClientError
from motord.recording.reader import open_run
from motord.schema import State
from tests.support.patience import until
from tests.system.daemons import daemon, wait_for, write_sim
from tests.system.test_operator import HELD, Terminal, finish, turning

pytestmark = [pytest.mark.system, pytest.mark.slow]

BEFORE_S = 9.0


@pytest.fixture
def running(tmp_path):
    path = write_sim(tmp_path)
    path.write_text(path.read_text() + "\n[recording]\nauto = false\n")
    with daemon(tmp_path, path) as program:
        yield program


def boxes(running):
    return sorted((running.folder / "runs" / "blackbox").glob("*.mcap"))


def the_box(running, number=1):
    """Return the newest black box, which is the `number`-th."""
    until(lambda: len(boxes(running)) >= number, "a black box")
    paths = boxes(running)
    assert len(paths) == number
    run = open_run(paths[-1])
    assert run.check() is None
    assert run.metadata["bench"] == "system"
    assert "[motor]" in run.metadata["config"]
    return run


def has_run_for(client, seconds):
    loop = client.state().loop
    wanted = loop.ticks + loop.missed + seconds * loop.rate_Hz
    wait_for(client, lambda s: s.loop.ticks + s.loop.missed > wanted, f"{seconds} s of ticks")


def check_ticks(ticks):
    numbers, missed = ticks["tick"].astype(int), ticks["missed"].astype(int)
    assert np.array_equal(np.diff(numbers) - 1, np.diff(missed))


def kill(pid):
    subprocess.run(["kill", "-9", str(pid)], check=True)


def test_a_trip_a_killed_loop_and_a_killed_daemon_leave_a_black_box_each(running):
    """Though nothing is recorded; that an orderly end leaves none, `test_isolation` shows."""
    with running.connect() as client, client.lease("anna") as lease:
        has_run_for(client, BEFORE_S + 1.0)
        client.rpc("enable", token=lease.token)
        client.rpc("set", token=lease.token, torque_Nm=3.0, brake=0.0)  # it runs away
        wait_for(client, lambda s: s.state == "TRIPPED", "a trip")
        [event] = [e for e in client.events() if e.kind == "trip"]
        until(lambda: any(e.kind == "blackbox" for e in client.events()), "word of the black box")
        run = the_box(running)
        check_box_of_the_trip(running, run, event)
        running.meant_to_trip()
        client.rpc("reset", token=lease.token)
        kill_the_loop(running, client, lease)
    with running.connect() as client:
        motord = Terminal(running, running.folder)
        commands = [motord.start(*HELD)]
        turning(client)
        commands += [motord.start(name, "--json") for name in ("watch", "events")]
        for command in commands[1:]:
            assert json.loads(command.stdout.readline())
        assert running.end(signal.SIGKILL) == -signal.SIGKILL
    run = the_box(running, number=3)
    for command in commands:
        check_ended_by_the_daemon_s_death(command)
    assert run.metadata["blackbox"]["cause"] == "daemon died"
    ticks = run.ticks(("tick", "state", "missed"))
    check_ticks(ticks)
    assert State.ENABLED in ticks["state"]
    assert not list((running.folder / "runs").glob("*.mcap*"))


def check_ended_by_the_daemon_s_death(command):
    code, _, err = finish(command)
    assert code == 1
    assert "motord: " in err.splitlines()[-1]
    assert "Traceback" not in err


def check_box_of_the_trip(running, run, event):
    assert event.data["blackbox"] == str(run.path)
    account = run.metadata["blackbox"]
    assert account["first"] == event.data["first"] == ["OVER_SPEED"]
    assert account["values"] == event.data["values"]
    assert account["action"]
    ticks = run.ticks(("tick", "state", "missed", "speed_rad_s"))
    check_ticks(ticks)
    tripped = ticks["tick"][ticks["state"] == State.TRIPPED]
    rate_Hz = running.config.loop.rate_Hz
    assert tripped[0] == event.data["tick"]
    assert tripped[0] - ticks["tick"][0] >= BEFORE_S * rate_Hz
    assert ticks["tick"][-1] - tripped[0] >= 0.9 * rate_Hz
    assert ticks["speed_rad_s"].max() > running.config.limits.trip_speed_rad_s
    kinds = [e["kind"] for e in run.events()]
    assert {"request", "state", "trip", "blackbox"} <= set(kinds)


def kill_the_loop(running, client, lease):
    client.rpc("enable", token=lease.token)
    has_run_for(client, 1.0)
    kill(client.state().processes["loop"].pid)
    state = wait_for(client, lambda s: s.fault, "the fault")
    assert (state.state, "SIGKILL" in state.fault) == ("OFF", True)
    with pytest.raises(ClientError, match="SIGKILL"):
        client.rpc("enable", token=lease.token)
    run = the_box(running, number=2)
    assert run.metadata["blackbox"]["cause"] == "loop died"
    assert "SIGKILL" in run.metadata["reason"]
    ticks = run.ticks(("tick", "state", "missed"))
    check_ticks(ticks)
    assert ticks["state"][-1] == State.ENABLED
    assert client.rpc("reset", token=lease.token) == {"state": "OFF"}
    assert wait_for(client, lambda s: s.tick is not None, "ticks").state == "OFF"
