"""`motord watch` on a terminal, with a daemon: keys, and what becomes of the bench without it."""

import os
import signal

import pytest
from typer.testing import CliRunner

from motord.cli import app
from tests.system.daemons import daemon, leave_at_rest, wait_for, write_sim
from tests.system.terminal import ScreenOf

pytestmark = pytest.mark.system

LEASE_S = 10.0
"""A program that a busy computer keeps from renewing keeps it; one that hangs loses it in time."""


@pytest.fixture(scope="module")
def running(folder):
    with daemon(folder, write_sim(folder, lease_s=LEASE_S)) as program:
        yield program


@pytest.fixture
def environment(running):
    return dict(
        os.environ,
        XDG_RUNTIME_DIR=str(running.folder),
        MOTORD_CONNECT=running.endpoint,
        LC_ALL="C.UTF-8",
    )


@pytest.fixture
def screen(environment, client):
    screen = ScreenOf(environment, "watch")
    try:
        screen.shows("OFF")
        yield screen
    finally:
        screen.close()
        leave_at_rest(client)


def enabled(screen, client):
    screen.press("e")
    wait_for(client, lambda s: s.state == "ENABLED", "the bench to be enabled")
    screen.shows("● ENABLED")
    screen.shows("lease: held here")


def test_the_stop_key_stops_the_bench_and_what_is_shown_is_the_daemons(screen, client):
    enabled(screen, client)
    before_ns = client.state().t_ns
    screen.press("s")
    wait_for(client, lambda s: s.state == "OFF", "the stop")
    screen.shows("○ OFF")
    screen.shows("stopped: the daemon says OFF")
    stops = [e.message for e in client.events() if e.t_ns > before_ns and "stop, from" in e.message]
    assert len(stops) == 1
    state = client.state()
    assert state.motor in screen.lines[0]
    screen.shows(f"{state.loop.rate_Hz:g} Hz, missed")
    screen.press("nit squeals\r")
    screen.shows("noted in")
    screen.shows("note: it squeals")
    screen.press("l")
    screen.shows("the lease was given back")
    enabled(screen, client)
    screen.press("q")
    screen.shows("the bench ramps down. Quit?")
    screen.press("y")
    check_ramped_down(client)
    assert screen.wait() == 0


@pytest.mark.parametrize("end", ["SIGTERM", "closed"])
def test_however_it_ends_the_bench_ramps_down(screen, client, end):
    enabled(screen, client)
    if end == "SIGTERM":
        os.kill(screen.pid, signal.SIGTERM)
    else:
        screen.close()
    check_ramped_down(client)
    screen.wait()


def check_ramped_down(client):
    wait_for(client, lambda s: s.state == "READY" and s.lease.holder is None, "disabled")
    assert "gave up command" in [e.message for e in client.events() if e.kind == "lease"][-1]


def test_a_terminal_that_takes_no_more_output_loses_the_lease(screen, client):
    enabled(screen, client)
    screen.read_no_more()

    def lost(state):
        for width in (100, 101):
            screen.resize(width, 30)  # drawn anew each time
        return state.state == "READY" and state.lease.holder is None

    wait_for(client, lost, "the lease to run out")
    messages = [event.message for event in client.events() if event.kind == "lease"]
    assert "ran out" in messages[-1] or "was lost" in messages[-1], messages
    screen.signal_another_thread(signal.SIGTERM)  # the kernel may choose any
    assert screen.wait() == 128 + signal.SIGTERM


def test_without_a_terminal_it_prints_lines(environment):
    done = CliRunner().invoke(app, ["watch", "--for-s", "0"], env=environment)
    assert done.exit_code == 0, done.stderr
    assert "OFF; torque" in done.stdout
    assert "\x1b" not in done.stdout
