"""What an operator does in terminals, with real processes: signals, takeovers, plans, pipes.

Judged by what the daemon says of itself: its events and its ticks.
"""

import os
import pty
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.schema import State
from tests.support.patience import PATIENCE_S, until
from tests.system.daemons import daemon, leave_at_rest, runtime_of, wait_for, write_sim

pytestmark = pytest.mark.system

TORQUE_Nm = 2.0
LEASE_S = 20.0
"""Who was taken over from notices at the next renewal, within a quarter of this."""
HELD = ("set", "--enable", "--torque-Nm", str(TORQUE_Nm), "--speed-Hz", "0.7")
ON_ITS_TERMINAL = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, "-m", "motord", *sys.argv[1:]])
"""


@pytest.fixture(scope="module")
def running(folder):
    with daemon(folder, write_sim(folder, lease_s=LEASE_S)) as program:
        yield program


class Terminal:
    """Starts commands for a daemon, as its operator does."""

    def __init__(self, running, folder):
        self.running, self.folder = running, folder
        self.environment = dict(
            os.environ, XDG_RUNTIME_DIR=str(folder), MOTORD_CONNECT=running.endpoint
        )

    def start(self, *arguments, **options):
        """Start a command and return its process, whose pipes have no buffer here."""
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "bufsize": 0, **options}
        return subprocess.Popen(
            [sys.executable, "-m", "motord", *arguments], env=self.environment, **options
        )

    def run(self, *arguments):
        """Run a command here to its end; return exit code, output and what came on stderr."""
        with runtime_of(self.folder):
            done = CliRunner().invoke(app, [*arguments, "--connect", self.running.endpoint])
        return done.exit_code, done.stdout, done.stderr


def finish(process):
    """Wait for the end of a command; return exit code, output and what came on stderr."""
    out, err = process.communicate(timeout=PATIENCE_S)
    return process.returncode, (out or b"").decode(), (err or b"").decode()


def in_command(command):
    """Wait until a command says that it is, and return this line: it does not begin any more."""
    line = command.stderr.readline().decode()
    assert line.startswith("in command "), line
    return line


@pytest.fixture
def motord(running, folder, client):
    """A terminal; whatever ends a command that it starts, no lease is left to run out."""
    begun_ns = client.state().t_ns
    yield Terminal(running, folder)
    leave_at_rest(client)
    messages = [event.message for event in events_since(client, begun_ns)]
    assert not [message for message in messages if "ran out" in message]


def events_since(client, t_ns):
    return [event for event in client.events() if event.t_ns > t_ns]


def turning(client):
    return wait_for(
        client, lambda s: s.tick is not None and s.tick.torque_set_Nm == TORQUE_Nm, "the torque"
    )


def check_ramped_down(client, running, ticks, begun_ns):
    """The lease was given back, the torque came down by its ramp, then the bench was disabled."""
    wait_for(client, lambda s: s.state == "READY" and s.lease.holder is None, "disabled")
    messages = [event.message for event in events_since(client, begun_ns)]
    assert not [message for message in messages if "TRIPPED" in message]
    given_up = [m for m in messages if m.endswith("gave up command: ramping down and disabling")]
    assert len(given_up) == 1
    until(lambda: ticks and ticks[-1]["state"][-1] == State.READY, "the ticks")
    seen = np.concatenate(ticks)
    torque_Nm = np.abs(seen["torque_set_Nm"][seen["state"] == State.ENABLED])
    falling = torque_Nm[np.flatnonzero(torque_Nm == TORQUE_Nm)[-1] :]
    assert falling[-1] < 0.05
    assert (np.diff(falling) < 0.0).all()  # with every tick, until there is none left
    step_Nm = running.config.limits.torque_rate_Nm_per_s / running.config.loop.rate_Hz
    assert len(falling) < 1.2 * TORQUE_Nm / step_Nm


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_each_signal_ramps_down_and_disables(motord, client, running, number):
    begun_ns, ticks = client.state().t_ns, []
    with client.subscribe_ticks(ticks.append):
        command = motord.start(*HELD)
        said = in_command(command)
        turning(client)
        command.send_signal(number)
        code, out, err = finish(command)
        check_ramped_down(client, running, ticks, begun_ns)
    assert (code, err) == (0, "")
    assert said == "in command until Ctrl-C; then the bench ramps down and is disabled\n"
    assert f"set: torque {TORQUE_Nm:g} Nm, reached in" in out


def test_a_terminal_that_is_closed_ramps_down_and_disables(motord, client, running):
    begun_ns, ticks = client.state().t_ns, []
    controller, terminal = pty.openpty()
    with client.subscribe_ticks(ticks.append):
        command = subprocess.Popen(
            [sys.executable, "-c", ON_ITS_TERMINAL, *HELD], env=motord.environment,
            stdin=terminal, stdout=terminal, stderr=terminal, start_new_session=True,
        )  # fmt: skip
        os.close(terminal)
        said = b""
        while b"in command" not in said:
            said += os.read(controller, 4096)
        state = turning(client)
        os.close(controller)
        assert command.wait(PATIENCE_S) == 0
        check_ramped_down(client, running, ticks, begun_ns)
    holder = state.lease.holder
    assert holder.endswith(f" {command.pid}")
    assert " pts/" in holder


def test_a_reader_that_leaves_does_not_end_the_command(motord, client):
    reading, writing = os.pipe()
    command = motord.start(*HELD, "--for-s", "600", stdout=writing)
    os.close(writing)
    os.close(reading)
    in_command(command)
    command.stderr.close()
    turning(client)
    command.send_signal(signal.SIGTERM)
    assert command.wait(PATIENCE_S) == 0
    assert wait_for(client, lambda s: s.state == "READY", "disabled").lease.holder is None


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        (("--torque-Nm", "99"), "99 Nm is above [limits] torque_Nm"),
        (("--torque-Nm", "nan"), "torque_Nm"),
        (("--torque-Nm", "1", "--speed-Hz", "40"), "[limits] trip_speed_rad_s"),
    ],
)
def test_a_refused_set_point_leaves_the_bench_off(motord, client, asked, expected):
    begun_ns = client.state().t_ns
    code, out, err = motord.run("set", "--enable", *asked)
    assert (code, out, len(err.splitlines())) == (1, "", 1)
    assert expected in err
    assert client.state().state == "OFF"
    assert not [event for event in events_since(client, begun_ns) if event.kind == "state"]


def test_after_a_takeover_others_use_the_token_of_the_winner(motord, client):
    loser = motord.start("enable")
    wait_for(client, lambda s: s.state == "ENABLED", "enabled")
    winner = motord.start("enable", "--force")
    in_command(winner)  # its token is there for others
    code, _, err = finish(loser)
    assert code == 1
    assert "took over command" in err
    code, out, err = motord.run("set", "--torque-Nm", "1", "--speed-Hz", "0.7")
    assert (code, err) == (0, "")
    assert out.startswith("set: torque 1 Nm")
    wait_for(client, lambda s: s.tick.torque_set_Nm == 1.0, "the torque")
    winner.send_signal(signal.SIGINT)
    assert finish(winner)[0] == 0
    wait_for(client, lambda s: s.state == "READY", "disabled")


def test_a_brake_is_held_for_as_long_as_the_command_runs(motord, client):
    command = motord.start("set", "--brake", "0.4")
    in_command(command)
    wait_for(client, lambda s: s.setpoint.brake == 0.4, "the brake")
    begun_s = client.state().uptime_s
    state = wait_for(client, lambda s: s.uptime_s > begun_s + 1.0, "a second")
    assert state.setpoint.brake == 0.4
    command.send_signal(signal.SIGINT)
    assert finish(command)[0] == 0
    assert wait_for(client, lambda s: s.lease.holder is None, "over").setpoint.brake == 0.0


def test_the_drive_turns_for_as_long_as_the_command_runs(motord, client):
    with client.lease("anna") as lease:
        client.rpc("enable", token=lease.token)
        client.rpc("disable", token=lease.token)
    command = motord.start("set", "--drive-Hz", "0.5")
    in_command(command)
    wait_for(client, lambda s: (s.tick.speed_Hz or 0.0) > 0.4, "the drive")
    state = client.state()
    assert (state.state, state.setpoint.drive_Hz) == ("READY", 0.5)
    command.send_signal(signal.SIGINT)
    assert finish(command)[0] == 0
    assert wait_for(client, lambda s: s.lease.holder is None, "over").setpoint.drive_Hz == 0.0


def plan(motord, *arguments):
    code, out, err = motord.run("plan", *arguments)
    assert (code, err) == (0, ""), err
    return out


TORQUES_NM = ",".join(f"{TORQUE_Nm + 0.01 * number:.2f}" for number in range(10))
SPEEDS_HZ = ",".join(f"{0.8 + 0.001 * number:.3f}" for number in range(60))
POINTS = 600
"""Of 3 s each, two turns and settling: half an hour, in which the plan does not end by itself."""
PLAN = [
    argument
    for setting in (
        f"torques_Nm={TORQUES_NM}",
        f"speeds_Hz={SPEEDS_HZ}",
        "turns=2",
        "settle_s=0.2",
        "gain_steps=[]",
    )
    for argument in ("--set", setting)
]


def test_a_plan_is_paused_resumed_and_aborted(motord, client):
    assert "calibrate started" in plan(motord, "start", "calibrate", "--detach", *PLAN)
    with client.subscribe_plan() as progress:

        def reported(condition):
            while not condition(view := progress.get(PATIENCE_S)):
                assert view is not None
            return view

        reported(lambda v: v.torque_set_Nm == TORQUE_Nm)
        plan(motord, "pause")
        paused = reported(lambda v: v.state == "paused")
        assert client.state().tick.torque_set_Nm == 0.0
        assert "calibrate paused, " in plan(motord, "status")
        assert client.plan().points_done == paused.points_done
        assert plan(motord, "resume") == "calibrate: running\n"
        taken = reported(lambda v: v.points_done > paused.points_done)
        assert taken.state == "running"
        assert plan(motord, "abort") == "calibrate: ending\n"
        over = reported(lambda v: v.over)
    assert over.state == "aborted"
    assert taken.points_done <= over.points_done < POINTS
    wait_for(client, lambda s: s.state == "READY", "disabled")
    said = plan(motord, "status")
    assert f"{over.points_done}/{POINTS}" in said
    assert "left" not in said
    assert "aborted by" in said
    assert said.splitlines()[1] == f"next: motord analyse calibrate {over.recording}"


def test_a_plan_that_is_followed_is_aborted_by_a_closed_terminal(motord, client):
    command = motord.start("plan", "start", "calibrate", *PLAN)
    wait_for(client, lambda s: s.state == "ENABLED" and s.setpoint.torque_Nm == TORQUE_Nm, "torque")
    command.send_signal(signal.SIGHUP)
    code, _, err = finish(command)
    assert code == 1
    # on a busy computer it may not have begun to follow: then it is its lease that ends the plan
    assert "calibrate aborted: aborted by" in err or err == "motord: interrupted\n"
    # READY comes first: a plan is over when its recording is closed
    state = wait_for(client, lambda s: s.state == "READY" and s.plan.over, "disabled")
    assert state.plan.state == "aborted"


@pytest.mark.parametrize("arguments", [("events",), ("watch", "--json")])
def test_what_goes_on_ends_when_nobody_reads_any_more(motord, arguments):
    command = motord.start(*arguments)
    assert command.stdout.readline()
    command.stdout.close()
    assert command.wait(PATIENCE_S) == 0
    assert command.stderr.read() == b""
    command.stderr.close()


def test_a_full_disk_is_one_line_and_exit_1(motord):
    with Path("/dev/full").open("wb") as full:
        code, _, err = finish(motord.start("status", stdout=full))
    assert (code, err) == (1, "motord: cannot write the output: No space left on device\n")
