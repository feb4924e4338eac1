"""Daemon and emulated devices, over CAN, serial line and Modbus, both in real time."""

import os
import signal
import time
from functools import partial

import numpy as np
import pytest

from motord.client import ClientError
from motord.record.reader import open_run
from motord.schema import State
from tests.system.daemons import Program, daemon, emulator, patient, wait_for, wait_until
from tests.system.test_daemon import check_ticks
from tests.unit.emulate.benches import write_bench

pytestmark = [pytest.mark.system, pytest.mark.slow]

INVERTER_TIMEOUT_S = 0.3
SUPERVISOR_TIMEOUT_S = 1.0
ZERO_A = 1e-6
HOLD_S = 180.0
MARGIN_S = 1.5
"""What a busy computer may take longer than the timeouts say."""


class Wire:
    """A daemon and its devices."""

    def __init__(self, running, devices, truth):
        self.daemon = running
        self.devices = devices
        self._truth = truth

    def truth(self):
        """End the devices and return what the rig truly did."""
        assert self.devices.end() == 0, self.devices.said()
        return open_run_truth(self._truth)


def open_run_truth(path):
    return open_run(path).truth()


@pytest.fixture
def wire(tmp_path, request):
    """A bench whose inverter waits 5 s for commands, or as long as the test's parameter says."""
    bench = write_bench(tmp_path)
    text = patient(bench.read_text(), "wire", 500, getattr(request, "param", 5.0))
    text = text.replace("[brake]\n", "[brake]\nstale_after_s = 5.0\n")
    bench.write_text(text)
    truth = tmp_path / "truth.mcap"
    with emulator(tmp_path, bench, truth) as devices, daemon(tmp_path, bench) as running:
        yield Wire(running, devices, truth)


def hold(client, lease, torque_Nm, speed_Hz, states_in_a_row):
    """Bring the bench to torque and speed until the speed has stayed there for some states.

    Returns the first and the last of them. A computer so busy that the bench trips costs another
    try.
    """
    deadline_s = time.monotonic() + HOLD_S
    while time.monotonic() < deadline_s:
        seen = []
        try:
            client.rpc("reset", token=lease.token)
            client.rpc("enable", token=lease.token)
            client.rpc("set", token=lease.token, torque_Nm=torque_Nm, speed_Hz=speed_Hz)
            wait_for(client, partial(_held, seen, speed_Hz, states_in_a_row), f"{speed_Hz} Hz")
        except ClientError as error:
            if error.code not in ("tripped", "timeout", "refused"):
                raise
        if seen:
            return seen[0], seen[-1]
    raise AssertionError(f"not held within {HOLD_S} s: {client.state()}")


def _held(seen, speed_Hz, states_in_a_row, state):
    """Collect states at full torque; true if their mean speed is right, or the bench gave up."""
    if state.state != "ENABLED":
        seen.clear()
        return True
    if abs(state.tick.torque_set_Nm - state.setpoint.torque_Nm) > 0.01:
        seen.clear()
        return False
    seen.append(state)
    del seen[:-states_in_a_row]
    mean_Hz = np.mean([s.tick.speed_Hz for s in seen])
    return len(seen) == states_in_a_row and abs(mean_Hz / speed_Hz - 1.0) < 0.1


def currents(truth, from_ns):
    """Return the largest true current of each sample from `from_ns` on."""
    later = truth[truth["t_ns"] >= from_ns]
    assert len(later) > 100
    return np.max([np.abs(later[f"i_{phase}_A"]) for phase in "abc"], axis=0)


def test_three_newton_metres_at_0_7_turns_a_second(wire):
    with wire.daemon.connect() as client:
        with client.lease("anna") as lease:
            begun, held = hold(client, lease, 3.0, 0.7, states_in_a_row=20)
            assert held.brake.health in ("ok", "failing")
            assert held.brake.setpoint == pytest.approx(held.setpoint.brake, abs=0.1)
            client.rpc("disable", token=lease.token)
        client.rpc("stop")
    assert wire.daemon.end() == 0, wire.daemon.said()
    [run] = wire.daemon.runs()
    ticks = run.ticks()
    check_ticks(ticks)
    during = (ticks["t_ns"] > begun.tick.t_ns) & (ticks["t_ns"] < held.tick.t_ns)
    assert np.mean(ticks["speed_rad_s"][during]) == pytest.approx(0.7 * 2 * np.pi, rel=0.25)
    truth = wire.truth()
    then = (truth["t_ns"] > begun.tick.t_ns) & (truth["t_ns"] < held.tick.t_ns)
    assert then.sum() > 300
    # without a calibration the phases' errors stand; their mean gain is 1.012
    assert np.mean(truth["torque_Nm"][then]) == pytest.approx(3.0 * 1.012, rel=0.04)


@pytest.mark.parametrize("wire", [INVERTER_TIMEOUT_S], indirect=True, ids=["short-timeout"])
@pytest.mark.parametrize("victim", ["loop", "supervisor"])
def test_kill_9_leaves_the_inverter_without_current(wire, victim):
    with wire.daemon.connect() as client:
        lease = client.lease("anna")
        lease.acquire()
        _, state = hold(client, lease, 2.0, 0.7, states_in_a_row=3)
        pids = {name: view.pid for name, view in state.processes.items()}
        pids["supervisor"] = wire.daemon.ready["pid"]
        killed_ns = time.time_ns()
        os.kill(pids[victim], signal.SIGKILL)
        if victim == "loop":
            assert wait_for(client, lambda s: s.fault, "the fault").state == "OFF"
        time.sleep(SUPERVISOR_TIMEOUT_S + MARGIN_S + 1.0)  # the emulator records meanwhile
    truth = wire.truth()
    timeout_s = INVERTER_TIMEOUT_S if victim == "loop" else SUPERVISOR_TIMEOUT_S + 0.2
    assert currents(truth, state.tick.t_ns - 200_000_000).max() > 1.0
    within_ns = killed_ns + round((timeout_s + MARGIN_S) * 1e9)
    assert currents(truth, within_ns).max() < ZERO_A


def test_kill_9_of_the_recorder_leaves_the_commander_in_command(wire):
    with wire.daemon.connect() as client, client.lease("anna") as lease:
        _, before = hold(client, lease, 2.0, 0.7, states_in_a_row=3)
        os.kill(before.processes["recorder"].pid, signal.SIGKILL)
        wait_for(client, lambda s: s.processes["recorder"].restarts == 1, "the next recorder")
        assert client.state().state == "ENABLED", client.state().trips
        assert client.rpc("stop") == {"state": "OFF"}
        stopped_ns = client.state().tick.t_ns
        wait_until(lambda: client.state().tick.t_ns > stopped_ns + 2_000_000_000, "2 s")
    assert wire.daemon.end() == 0
    ticks = np.concatenate([r.ticks(("tick", "missed", "flags")) for r in wire.daemon.runs()])
    check_ticks(ticks)
    assert currents(wire.truth(), stopped_ns + round(MARGIN_S * 1e9)).max() < ZERO_A


def test_sigterm_ramps_down_on_the_wire(wire):
    with wire.daemon.connect() as client:
        lease = client.lease("anna")
        lease.acquire()
        hold(client, lease, 2.0, 0.7, states_in_a_row=3)
        assert wire.daemon.end() == 0
        lease.release()
    ended_ns = time.time_ns()
    [run] = wire.daemon.runs()
    assert State(int(run.ticks(("state",))["state"][-1])) is State.OFF
    time.sleep(1.5)
    truth = wire.truth()
    assert currents(truth, ended_ns).max() < ZERO_A
    assert (truth["enable_line"][-100:] == 0).all()


def test_a_daemon_without_its_devices_says_which(tmp_path):
    bench = write_bench(tmp_path)
    program = Program(tmp_path, "run", "-c", bench, ready=False)
    assert program.wait() == 1
    assert program.said().splitlines()[-1].startswith("motord: [brake.modbus] 127.0.0.1")
    without_brake = bench.read_text().replace('driver = "modbus"', 'driver = "none"')
    bench.write_text(without_brake)
    program = Program(tmp_path, "run", "-c", bench, ready=False)
    assert program.wait() == 1
    last = program.said().splitlines()[-1]
    assert "bridge: cannot open" in last
    assert "is the board plugged in" in last
