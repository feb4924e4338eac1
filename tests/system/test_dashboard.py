"""`motord dashboard` with a daemon: what pages command, and what becomes of it when they go."""

import re
import signal
import socket
import subprocess
import urllib.error
import urllib.request
from contextlib import suppress

import numpy as np
import pytest
from typer.testing import CliRunner
from websockets.exceptions import ConnectionClosed, InvalidStatus

from motord.cli import app
from motord.dashboard.app import MALFORMED
from motord.schema import State
from tests.support.patience import PATIENCE_S, until
from tests.system.daemons import (
    daemon,
    leave_at_rest,
    runtime_of,
    wait_for,
    write_sim,
)
from tests.system.pages import dashboard, opened

pytestmark = pytest.mark.system

TORQUE_Nm = 1.0
LEASE_S = 10.0
"""A page that a busy computer keeps from answering keeps it; one that hangs loses it in time."""


@pytest.fixture(scope="module")
def running(folder):
    with daemon(folder, write_sim(folder, lease_s=LEASE_S)) as program:
        yield program


@pytest.fixture(scope="module")
def server(running, folder):
    with dashboard(folder, running.endpoint) as program:
        yield program
        assert program.end(signal.SIGINT) == 0
        assert program.said() == ""


@pytest.fixture
def at_rest(client):
    """What a test leaves behind is over before the next one."""
    yield
    leave_at_rest(client)


def turning(page):
    """Take command and turn."""
    reply = page.ask("lease/acquire")
    assert "holder" in reply, reply
    assert page.ask("set", enable=True, torque_Nm=TORQUE_Nm, speed_Hz=0.7)["state"] == "ENABLED"
    state = page.state(lambda s: s["tick"]["torque_set_Nm"] == TORQUE_Nm)
    assert state["lease"]["holder"] == reply["holder"]
    return reply["holder"]


def check_ramped_down(client, begun_ns):
    """The lease was given back, so the torque came down by its ramp."""
    wait_for(client, lambda s: s.state == "READY" and s.lease.holder is None, "disabled")
    messages = [event.message for event in client.events() if event.t_ns > begun_ns]
    assert len([m for m in messages if m.endswith("ramping down and disabling")]) == 1
    assert not [m for m in messages if "ran out" in m or "TRIPPED" in m]


def check_closed(receive):
    with suppress(ConnectionClosed):
        for _ in range(10_000):
            receive()
        raise AssertionError("the socket is still open")


def status_of(server, path="/session", **headers):
    request = urllib.request.Request(server.base + path, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as reply:
            return reply.status
    except urllib.error.HTTPError as error:
        return error.code


def test_a_page_operates_the_bench(server, client, at_rest):
    with opened(server) as page:
        page.send(
            kind="view", view=1, span_s=5.0, end_s=None, buckets=100, signals=["torque_set_Nm"]
        )
        holder = turning(page)
        assert re.search(r"page \d+$", holder)
        page.until("trace", lambda h: not h["whole"])
        turns, floats = page.until("turns", lambda h: h["turns"] >= 1)
        assert len(floats) == (turns["turns"] + 1) * turns["bins"] + turns["orders"]
        assert page.ask("disable")["state"] == "READY"
        assert page.ask("lease/release") == {}
        page.state(lambda s: s["lease"]["holder"] is None)


def test_who_may_not_come_in_gets_an_error(server):
    good = {"Authorization": f"Bearer {server.operator}"}
    assert status_of(server, **good) == 200
    assert status_of(server, Authorization="Bearer wrong") == 401
    assert status_of(server, Host="bench.example", **good) == 403
    assert status_of(server, Origin="http://example.com", **good) == 403
    for options in ({"token": "wrong"}, {"origin": "http://example.com"}):
        with pytest.raises(InvalidStatus), server.open(**options):
            pass


def test_it_listens_on_this_machine_alone(server):
    found = subprocess.run(["ss", "-ltnH"], capture_output=True, text=True, check=False).stdout
    if not found:
        pytest.skip("needs ss: apt-get install iproute2")
    addresses = [line.split()[3] for line in found.splitlines()]
    assert [a for a in addresses if a.endswith(f":{server.port}")] == [f"127.0.0.1:{server.port}"]


def test_a_malformed_frame_moves_nothing_and_the_server_goes_on(server, client, at_rest):
    with opened(server) as good, opened(server) as bad:
        holder = turning(good)
        bad.socket.send(b"\xff" * 64)
        header, _ = bad.until("error")
        assert header["code"] == MALFORMED
        check_closed(bad.next)
        with server.open() as garbled:  # no WebSocket frame at all
            garbled.socket.sendall(b"\xff" * 4096)
            check_closed(lambda: garbled.recv(timeout=PATIENCE_S))
        good.state(lambda s: s["state"] == "ENABLED" and s["lease"]["holder"] == holder)


def test_two_operators_in_two_tabs(server, at_rest):
    with opened(server) as first, opened(server) as second:
        holder = turning(first)
        assert second.ask("enable")["code"] == "no_lease"
        refused = second.ask("lease/acquire")
        assert refused["code"] == "lease_held"
        assert holder in refused["message"]
        taken = second.ask("lease/acquire", force=True)
        assert taken["took_over_from"] == holder
        lost, _ = first.until("lease", lambda h: not h["held"])
        assert taken["holder"] in lost["why"]
        assert first.ask("set", torque_Nm=0.5)["code"] == "no_lease"
        assert first.ask("stop")["state"] == "OFF"  # whoever is in command
        second.state(lambda s: s["state"] == "OFF")


def test_a_viewer_watches_and_commands_nothing(server, client):
    with opened(server, server.viewer) as page:
        page.state(lambda s: s["bench"] == client.bench)
        for name in ("lease/acquire", "stop", "set"):
            assert page.ask(name)["code"] == "forbidden"
        assert page.ask("plan/list")["plans"]


def test_a_page_that_is_killed_ramps_down(server, client, at_rest):
    begun_ns = client.state().t_ns
    with opened(server) as page:
        turning(page)
        page.socket.socket.shutdown(socket.SHUT_RDWR)  # no closing handshake
        check_ramped_down(client, begun_ns)


def test_a_page_that_hangs_loses_the_lease(server, client, at_rest):
    with opened(server) as page:
        turning(page)
        page.hang()
        state = wait_for(client, lambda s: s.lease.holder is None, "the lease to end")
        assert state.state in ("READY", "ENABLED")  # ramping down
        wait_for(client, lambda s: s.state == "READY", "disabled")
        assert "ran out" in page.until("lease", lambda h: not h["held"])[0]["why"]


def test_a_page_that_reads_nothing_costs_nothing(server, client):
    """Its socket is full; others are served, and it is sent what is new once it reads."""
    with opened(server, hangs=True) as stuck, opened(server) as page:
        stuck.send(
            kind="view", view=1, span_s=60.0, end_s=None, buckets=8000, signals=["i_a_A", "i_b_A"]
        )
        for _ in range(10):
            page.state(lambda s: True)
        stuck.state(lambda s: s["state"] == "OFF")


PING = bytes([0x89, 0x80 | 125]) + bytes(4 + 125)


def test_a_page_that_pings_and_reads_nothing_is_cut_off(server, client):
    """Answers to pings are not waited for: they would fill the server's memory."""
    asked = [
        "GET /socket HTTP/1.1", f"Host: 127.0.0.1:{server.port}", "Upgrade: websocket",
        "Connection: Upgrade", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version: 13", f"Sec-WebSocket-Protocol: motord.1, {server.viewer}", "", "",
    ]  # fmt: skip
    with opened(server) as page, socket.create_connection(("127.0.0.1", server.port)) as deaf:
        deaf.sendall("\r\n".join(asked).encode())
        assert deaf.recv(12) == b"HTTP/1.1 101"
        with pytest.raises(ConnectionError):
            deaf.sendall(500_000 * PING)
        page.seen.clear()
        page.state(lambda s: s["bench"] == client.bench)


def test_a_killed_server_leaves_loop_and_recording_as_they_were(running, folder, client, at_rest):
    """It was in command; `test_silent_commander` and `test_isolation` show clients that stop."""
    ticks = []
    with dashboard(folder, running.endpoint) as commanding, opened(commanding) as page:
        turning(page)
        before = wait_for(client, lambda s: s.recording.recording, "a recording")
        with client.subscribe_ticks(ticks.append), client.subscribe_state() as states:
            commanding.process.send_signal(signal.SIGKILL)
            while (after := states.get(PATIENCE_S)).state != "READY":
                pass  # of the states that are READY the first: the recording ends soon
            assert after.lease.holder is None
            until(lambda: ticks and ticks[-1]["state"][-1] == State.READY, "the ticks")
    seen = np.concatenate(ticks)
    missed = int(seen["missed"][-1]) - int(seen["missed"][0])
    assert int(seen["tick"][-1]) - int(seen["tick"][0]) == len(seen) - 1 + missed
    assert after.loop.lost_by_supervisor == before.loop.lost_by_supervisor
    assert after.recording.path == before.recording.path
    assert not after.recording.error


@pytest.mark.parametrize(
    ("arguments", "code", "expected"),
    [
        (("--connect", "tcp/127.0.0.1:1"), 1, "no motord at tcp/127.0.0.1:1"),
        (("--host", "0.0.0.0"), 1, "ssh -L"),
        (("--host", "::1"), 1, "listens on 127.0.0.1 alone"),
        (("--port", "{port}"), 1, "another `motord dashboard`"),
    ],
)
def test_what_cannot_be_is_reported_in_one_line(server, running, folder, arguments, code, expected):
    given = [argument.format(port=server.port) for argument in arguments]
    connection = [] if "--connect" in given else ["--connect", running.endpoint]
    with runtime_of(folder):
        done = CliRunner().invoke(app, ["dashboard", "--no-browser", *given, *connection])
    assert done.exit_code == code
    assert expected in done.stderr.replace("\n", " ")
    if code == 1:
        assert len(done.stderr.splitlines()) == 1
