"""`motord bridge foxglove` and `motord dashboard` over a restart of their daemon.

Both serve on, come back, and harm nobody.
"""

import json
import os
import signal
import socket
import sys
from contextlib import ExitStack

import pytest
from typer.testing import CliRunner

from motord.cli import app
from tests.support.foxglove_client import Viewer
from tests.support.patience import until
from tests.support.ports import free_port
from tests.system.daemons import Program, daemon, write_sim
from tests.system.pages import dashboard, opened
from tests.system.test_dashboard import LEASE_S, check_ramped_down, turning

pytestmark = pytest.mark.system


@pytest.fixture(scope="module")
def path(folder):
    return write_sim(folder, "bridged", lease_s=LEASE_S)


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


def test_both_survive_the_daemon_and_harm_nobody(folder, path, bridge):
    with daemon(folder, path) as running, ExitStack() as stack:
        program, ready = bridge(running)
        serves(running, program, ready)
        server = stack.enter_context(dashboard(folder, running.endpoint))
        page = stack.enter_context(opened(server))
        page.send(kind="view", view=1, span_s=60.0, end_s=None, buckets=60, signals=["u_bus_V"])
        assert "holder" in page.ask("lease/acquire")
        page.until("trace")
        page.seen.clear()
        running.end()
        with Viewer(ready["url"]) as viewer:
            viewer.receive_until(lambda: viewer.statuses, "that the daemon is gone")
            assert viewer.statuses[0]["level"] == 2
        assert "connecting again" in program.said()
        assert program.process.poll() is None
        gone, _ = page.until("connection", lambda h: not h["alive"])
        assert "bridged" in gone["message"]
        while page.latest["lease"]["held"]:
            page.next()
        with daemon(folder, path) as running:
            until(lambda: "bench bridged is back" in program.said(), "the connection")
            with Viewer(ready["url"]) as viewer:
                viewer.subscribe("/bench")
                assert viewer.next("/bench").content["bench"] == "bridged"
            assert program.end() == 0
            flooded_and_killed(running, bridge)
            page_comes_back(running, server, page)


def serves(running, program, ready):
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


def page_comes_back(running, server, page):
    """A page that stayed open is served again; the end of its server gives its lease back."""
    while not page.seen["hello"] or not page.latest["connection"]["alive"]:
        page.next()
    page.until("trace")
    assert page.ask("enable")["code"] == "no_lease"
    assert page.ask("lease/acquire")["took_over_from"] is None
    assert page.ask("enable")["state"] == "ENABLED"
    assert page.ask("stop")["state"] == "OFF"
    with running.connect() as client:
        begun_ns = client.state().t_ns
        turning(page)
        assert server.end(signal.SIGTERM) == 0
        check_ramped_down(client, begun_ns)


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
            until(lambda: client.state().loop.ticks > before + 200, "ticks")
            newest = client.state().t_ns
            while reader.next("/tick").t_ns < newest:
                pass
        program.process.send_signal(signal.SIGSTOP)
        before = client.state().loop.ticks
        until(lambda: client.state().loop.ticks > before + 200, "ticks")
        program.process.kill()
        program.wait()
        state = client.state()
        assert (state.state, state.fault, state.telemetry_dropped) == ("OFF", "", 0)
        assert state.loop.lost_by_supervisor == 0


def one_line_of(done):
    assert (done.exit_code, done.stdout) == (1, "")
    assert len(done.stderr.splitlines()) == 1
    return done.stderr


def test_without_a_daemon_it_is_one_line():
    nobody = f"tcp/127.0.0.1:{free_port()}"
    line = one_line_of(CliRunner().invoke(app, ["bridge", "foxglove", "--connect", nobody]))
    assert f"no motord at {nobody}" in line


def test_without_its_package_it_is_one_line(monkeypatch):
    monkeypatch.delitem(sys.modules, "motord.foxglove.server", raising=False)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    line = one_line_of(CliRunner().invoke(app, ["bridge", "foxglove"]))
    assert "pip install 'motord[foxglove]'" in line
