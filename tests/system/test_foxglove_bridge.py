"""`motord bridge foxglove` with a daemon: it serves, it comes back, and it harms nobody."""

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack

import pytest

from tests.support.foxglove_client import Viewer
from tests.support.ports import free_port
from tests.system.daemons import Program, daemon, wait_until, write_sim

pytestmark = pytest.mark.system


@pytest.fixture(scope="module")
def path(folder):
    return write_sim(folder, "bridged")


@pytest.fixture
def bridge(folder):
    """Start bridges, which end with the test."""
    with ExitStack() as stack:

        def start(running, port=0):
            program = Program(
                folder, "bridge", "foxglove", "--connect", running.endpoint,
                "--port", port, "--json",
            )  # fmt: skip
            stack.callback(program.close)
            return program, json.loads(program.first_line)

        yield start


def test_a_bridge_serves_survives_the_daemon_and_harms_nobody(folder, path, bridge):
    with daemon(folder, path) as running:
        program, ready = bridge(running)
        assert ready["bench"] == "bridged"
        with Viewer(ready["url"]) as viewer, running.connect() as client:
            viewer.subscribe("/tick", "/state", "/event")
            first, second = viewer.next("/tick"), viewer.next("/tick")
            assert second.t_ns - first.t_ns > 0
            assert second.t_ns == second.content.t_ns
            assert viewer.next("/state").content["state"] == "OFF"
            assert "bench.name" in viewer.get_parameters()
            client.rpc("stop", by="test")
            while "stop" not in viewer.next("/event").content["message"]:
                pass  # a busy computer is an event, too
        running.end()
        with Viewer(ready["url"]) as viewer:
            viewer.receive_until(lambda: viewer.statuses, "that the daemon is gone")
            assert viewer.statuses[0]["level"] == 2
        assert "connecting again" in program.said()
        assert program.process.poll() is None
    with daemon(folder, path) as running:
        wait_until(lambda: "bench bridged is back" in program.said(), "the connection")
        with Viewer(ready["url"]) as viewer:
            viewer.subscribe("/bench")
            assert viewer.next("/bench").content["bench"] == "bridged"
        assert program.end() == 0
        flooded_and_killed(running, bridge)


def flooded_and_killed(running, bridge):
    """Viewers that never read, a stopped bridge, a killed one: the daemon goes on as before."""
    with running.connect() as client, ExitStack() as stack:
        program, ready = bridge(running)
        for _ in range(20):
            viewer = Viewer(ready["url"])
            stack.callback(viewer.hang_up)
            viewer.subscribe("/tick", "/tick_extremes", "/state")  # and reads no more
        host, port = ready["url"].removeprefix("ws://").split(":")
        with socket.create_connection((host, int(port))) as noise:
            noise.sendall(os.urandom(4096))
        with Viewer(ready["url"]) as reader:
            reader.subscribe("/tick")
            before = client.state().loop.ticks
            wait_until(lambda: client.state().loop.ticks > before + 200, "ticks")
            newest = client.state().t_ns
            while reader.next("/tick").t_ns < newest:
                pass
        program.process.send_signal(signal.SIGSTOP)
        before = client.state().loop.ticks
        wait_until(lambda: client.state().loop.ticks > before + 200, "ticks")
        program.process.kill()
        program.wait()
        state = client.state()
        assert (state.state, state.fault, state.telemetry_dropped) == ("OFF", "", 0)
        assert state.loop.lost_by_supervisor == 0


def test_what_cannot_be_is_one_line(folder, path):
    def said(*arguments):
        done = subprocess.run(
            [sys.executable, *arguments], capture_output=True, text=True, check=False
        )
        assert done.returncode == 1
        assert done.stdout == ""
        assert len(done.stderr.splitlines()) == 1
        return done.stderr

    nobody = f"tcp/127.0.0.1:{free_port()}"
    line = said("-m", "motord", "bridge", "foxglove", "--connect", nobody)
    assert f"no motord at {nobody}" in line
    without = "import sys; sys.modules['foxglove'] = None; sys.argv[0] = 'motord'; "
    line = said("-c", without + "from motord.cli import main; main()", "bridge", "foxglove")
    assert "pip install 'motord[foxglove]'" in line
