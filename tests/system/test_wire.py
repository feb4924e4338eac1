"""Daemon and emulated devices, over CAN, serial line and Modbus, both in real time."""

import os
import re
import signal
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
import psutil
import pytest

from motord.client import ClientError
from motord.hal.bridge.drift_estimator import DRIFT_MAX
from motord.recording.file_names import stem_of, whole_of
from motord.recording.reader import open_run
from motord.schema import State
from motord.shm.ring import RingReader
from motord.shm.run_directory import RunDir
from tests.support import stalls
from tests.support.patience import until
from tests.system.daemons import (
    STALE_S,
    Program,
    daemon,
    emulator,
    forgive,
    patient,
    resets,
    stalls_from_now,
    wait_for,
)
from tests.system.test_daemon import check_ticks
from tests.unit.emulate.benches import DRAG, write_bench

pytestmark = [pytest.mark.system, pytest.mark.slow]

INVERTER_TIMEOUT_S = STALE_S
ZERO_A = 1e-6
RAMP_S = 0.3
"""From 3 Nm at 10 Nm/s."""
BRAKE_STEP = 1e-4
"""Of the brake's register."""
STANDS_RAD = 1.5 * 2 * np.pi / 4096
"""Counts over which a rotor that stands is read."""
LAG_RAD = 0.5
"""Of the currents on average, electrical: 14 ms at 0.7 turns/s and 8 pole pairs."""
DECAYED_S = 0.02
"""Of emulated time, until no current is left: 5 ms at once, and the inverter's lag."""


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


def check_torque(truth, motor, torque_Nm, tolerance):
    """Check the torque that the true currents make, and that they follow the rotor.

    A loop that a busy computer keeps from running long enough commands no current, and a current
    that is held meanwhile lags behind the rotor: that it then makes less torque is right, and up to
    the computer. So rows without current do not count, and of the others what they would make in
    time, apart from their lag. In virtual time `tests/firmware/test_in_the_loop.py` asks for the
    torque itself.
    """
    table = motor.back_emf_table()
    count = np.round(truth["angle_rad"] * motor.counts / (2 * np.pi)).astype(int)
    currents_A = np.column_stack([truth[f"i_{phase}_A"] for phase in "abc"])
    along_Nm, across_Nm = (
        (table[(count + ahead) % motor.counts] * currents_A).sum(axis=1)
        for ahead in (0, motor.counts // (4 * motor.pole_pairs))
    )
    made_Nm = along_Nm - 1j * across_Nm
    made_Nm = made_Nm[np.abs(made_Nm) > 2 / 3 * torque_Nm]
    assert made_Nm.size > 100
    # without a calibration the phases' errors stand; their mean gain is 1.012
    assert np.abs(made_Nm).mean() == pytest.approx(1.012 * torque_Nm, rel=tolerance)
    assert abs(np.angle(made_Nm.mean())) < LAG_RAD


def check_held_speed(ticks, begun, held):
    """Check that the rotor made 0.7 turns a second between the first and the last state of `hold`.

    By angle and time, as it was held: a busy computer misses ticks, more of the slow ones perhaps.
    """
    check_ticks(ticks)
    during = ticks[(ticks["t_ns"] >= begun.tick.t_ns) & (ticks["t_ns"] <= held.tick.t_ns)]
    turned_rad = np.ptp(np.unwrap(during["angle_rad"].astype(float)))
    took_s = (during["t_ns"][-1] - during["t_ns"][0]) * 1e-9
    assert turned_rad / took_s == pytest.approx(0.7 * 2 * np.pi, rel=0.25)


def on_can(text: str) -> str:
    """Return a bench file with its board on the channel of its inverter."""
    options = re.search(r"^options = .*$", text, flags=re.MULTILINE)
    assert options is not None
    text = re.sub(r'driver = "serial"\nport = .*\n', 'driver = "can"\n', text, count=1)
    bus = f'interface = "udp_multicast"\nchannel = "239.74.163.2"\nfd = true\n{options.group()}\n'
    text = text.replace('name = "wire"', f'name = "bridge-on-can-{time.time_ns()}"')
    return f"{text}\n[bridge.can]\n{bus}"


@pytest.fixture(params=[str], ids=["serial bridge"])
def wire(tmp_path, request):
    """A bench with a serial bridge, or with what the parameter makes of the text of its file."""
    bench = write_bench(tmp_path, rig=DRAG)
    text = patient(bench.read_text(), "wire", 500, INVERTER_TIMEOUT_S)
    text = text.replace("[brake]\n", "[brake]\nstale_after_s = 5.0\n")
    bench.write_text(request.param(text))
    truth = tmp_path / "truth.mcap"
    with emulator(tmp_path, bench, truth) as devices, daemon(tmp_path, bench) as running:
        yield Wire(running, devices, truth)


def hold(
    client,
    lease,
    torque_Nm,
    speed_Hz,
    states_in_a_row,
    limit_s=STALE_S,
    *,
    board_is_a_process=False,
):
    """Bring the bench to torque and speed until the speed has stayed there for some states.

    At speed 0 the rotor has stood. Returns the first and the last of the states. A trip that
    a computer too busy explains, and no other, costs another try (`tests.support.stalls`), which
    has a recording of its own: the last one is that of the states. `limit_s` is the bench's
    shortest limit; `board_is_a_process` as `forgive` takes it.
    """
    forgive_trip = partial(forgive, client, board_is_a_process=board_is_a_process)
    while True:
        kept, seen = stalls_from_now(client), []
        try:
            until(lambda: resets(client, lease), "no cause of a trip to be left")
            client.rpc("enable", token=lease.token)
            speed = {"speed_Hz": speed_Hz} if speed_Hz else {}
            client.rpc("set", token=lease.token, torque_Nm=torque_Nm, **speed)
            wait_for(client, partial(_held, seen, speed_Hz, states_in_a_row), f"{speed_Hz} Hz")
            if seen:
                return seen[0], seen[-1]
            forgive_trip(kept, limit_s=limit_s)
        except ClientError as error:
            if error.code not in ("tripped", "timeout", "refused"):
                raise
            forgive_trip(kept, error, limit_s)


def _held(seen, speed_Hz, states_in_a_row, state):
    """Collect states at full torque; true if their mean speed is right, or the bench gave up."""
    if state.state != "ENABLED":
        seen.clear()
        return True
    if abs(state.tick.torque_set_Nm - state.setpoint.torque_Nm) > 0.01:
        seen.clear()
        return False
    if seen and state.tick.t_ns - seen[-1].tick.t_ns > 1e9 * stalls.QUARTER_TURN_S:
        seen.clear()  # a turn more or less would not show in their angles
    seen.append(state)
    del seen[:-states_in_a_row]
    if len(seen) < states_in_a_row:
        return False
    angle_rad = np.unwrap([s.tick.angle_rad for s in seen])
    if speed_Hz == 0.0:
        return np.ptp(angle_rad) < STANDS_RAD
    # not the mean of their speeds: the rotor is jerky, and some of its speeds say little
    took_s = (seen[-1].tick.t_ns - seen[0].tick.t_ns) * 1e-9
    turns = (angle_rad[-1] - angle_rad[0]) / (2 * np.pi)
    return took_s > 0.0 and abs(turns / took_s / speed_Hz - 1.0) < 0.1


def currents(truth, from_ns, within_s=0.0):
    """Return the largest true current of each row from `within_s` after `from_ns` on.

    This time is that of the rig: where the emulator was kept from running, it left rows out.
    """
    later = truth[truth["t_ns"] >= from_ns]
    step_ns = np.median(np.diff(truth["t_ns"]))
    passed_ns = np.cumsum(np.minimum(np.diff(later["t_ns"], prepend=from_ns), step_ns))
    later = later[passed_ns >= within_s * 1e9]
    assert len(later) > 100
    return np.max([np.abs(later[f"i_{phase}_A"]) for phase in "abc"], axis=0)


def go_on(devices, wakes=2000):
    """Wait until the emulator has been run so many times more: about as many milliseconds.

    It leaves 500 rows a second, fewer while it is kept from running; `currents` asks for 100.
    """
    enough = stalls.runs(devices.process.pid) + wakes
    until(lambda: stalls.runs(devices.process.pid) > enough, "the emulator")


def check_brake(ticks, begun, held):
    """What the brake was last sent is one of its servo's set-points since `begun`, which move."""
    then = (ticks["t_ns"] >= begun.tick.t_ns) & (ticks["t_ns"] <= held.tick.t_ns)
    asked = ticks["brake_set"][then]
    assert np.abs(asked - held.brake.setpoint).min() <= BRAKE_STEP
    assert 0.0 < held.brake.setpoint < 1.0


def test_recorder_and_loop_are_killed_then_three_newton_metres_and_sigterm_ramps_down(wire):
    with wire.daemon.connect() as client:
        lease = client.lease("anna")
        lease.acquire()
        recorder = kill_the_recorder(wire, client, lease)
        loop = kill_the_loop(wire, client, lease)
        until(lambda: resets(client, lease), "the next loop")
        begun, held = hold(client, lease, 3.0, 0.7, states_in_a_row=20)
        assert held.brake.health in ("ok", "failing")
        assert wire.daemon.end() == 0, wire.daemon.said()
        lease.release()
        assert lease.lost.is_set()
    ended_ns = time.time_ns()
    ticks = wire.daemon.runs()[-1].ticks()
    check_held_speed(ticks, begun, held)
    check_brake(ticks, begun, held)
    assert abs(ticks["torque_set_Nm"][ticks["state"] == State.ENABLED][-1]) < 0.05
    assert State(int(ticks["state"][-1])) is State.OFF
    go_on(wire.devices)
    truth = wire.truth()
    then = (truth["t_ns"] > begun.tick.t_ns) & (truth["t_ns"] < held.tick.t_ns)
    check_torque(truth[then], wire.daemon.config.motor, 3.0, 0.04)
    assert currents(truth, ended_ns, DECAYED_S).max() < ZERO_A
    assert (truth["enable_line"][-100:] == 0).all()
    a_stop_took_the_current_away_whoever_recorded(wire, truth, recorder)
    a_loop_that_was_killed_left_no_current(wire, truth, loop)


@dataclass(frozen=True)
class CurrentGone:
    """The bench was enabled; what was to take the current away came; then the rig went on.

    recording: its name while the bench was enabled. by_ns: the emulator has run since the current
    was to be gone.
    """

    enabled_ns: int
    came_ns: int
    over_ns: int
    recording: str = ""
    by_ns: int = 0

    def rows(self, truth):
        return truth[truth["t_ns"] < self.over_ns]


def kill_the_recorder(wire, client, lease):
    """Kill it under a bench that is enabled, whose commander stops the bench then.

    Again after a trip meanwhile that a stall explains.
    """
    for kills in count(1):
        _, before = hold(client, lease, 2.0, 0.7, states_in_a_row=3)
        kept = stalls_from_now(client)
        os.kill(before.processes["recorder"].pid, signal.SIGKILL)
        restarted = partial(_restarted, kills)
        if wait_for(client, restarted, "the next recorder").state == "ENABLED":
            break
        forgive(client, kept)
    assert client.rpc("stop") == {"state": "OFF"}
    stopped_ns = client.state().tick.t_ns
    until(lambda: client.state().tick.t_ns > stopped_ns + 500_000_000, "0.5 s")
    go_on(wire.devices)
    recording = stem_of(Path(before.recording.final_path)).name
    return CurrentGone(before.tick.t_ns, stopped_ns, time.time_ns(), recording)


def _restarted(times, state):
    return state.processes["recorder"].restarts == times


def a_stop_took_the_current_away_whoever_recorded(wire, truth, killed):
    runs = wire.daemon.runs()
    files = [run for run in runs if stem_of(whole_of(run.path)).name == killed.recording]
    assert len(files) > 1
    check_ticks(np.concatenate([file.ticks(("tick", "missed", "flags")) for file in files]))
    assert currents(killed.rows(truth), killed.came_ns, DECAYED_S).max() < ZERO_A


def kill_the_loop(wire, client, lease):
    _, state = hold(client, lease, 2.0, 0.7, states_in_a_row=3)
    os.kill(state.processes["loop"].pid, signal.SIGKILL)
    killed_ns = time.time_ns()
    assert wait_for(client, lambda s: s.fault, "the fault").state == "OFF"
    due_ns = killed_ns + round(INVERTER_TIMEOUT_S * 1e9)
    until(lambda: time.time_ns() > due_ns, "the inverter's timeout")
    go_on(wire.devices, wakes=200)  # a busy computer may have kept it from running until now
    by_ns = time.time_ns()
    go_on(wire.devices)
    return CurrentGone(state.tick.t_ns, killed_ns, time.time_ns(), by_ns=by_ns)


def a_loop_that_was_killed_left_no_current(wire, truth, killed):
    """The inverter's own timeout takes it away, by the host's clock: that of the rig stands still.

    There are no rows from `rig_patience_s` after the last command until then.
    """
    truth = killed.rows(truth)
    assert currents(truth, killed.enabled_ns - 200_000_000).max() > 1.0
    patience_s = wire.daemon.config.bench.rig_patience_s
    assert currents(truth, killed.came_ns, patience_s + DECAYED_S).max() < ZERO_A
    in_time = truth[(truth["t_ns"] > killed.came_ns) & (truth["t_ns"] < killed.by_ns)]
    assert np.max([np.abs(in_time[f"i_{phase}_A"][-1]) for phase in "abc"]) < ZERO_A


def stays_tripped(ring, tripped):
    """Collect the numbers of tripped ticks; return whether there are enough to judge."""
    ticks, _ = ring.read()
    tripped.extend(ticks["tick"][ticks["state"] == State.TRIPPED])
    return len(tripped) > 200


@pytest.mark.parametrize("wire", [on_can], indirect=True, ids=["bridge on CAN"])
def test_three_newton_metres_then_kill_9_of_the_supervisor_ramps_down(wire):
    with wire.daemon.connect() as client:
        lease = client.lease("anna")
        lease.acquire()
        begun, state = hold(client, lease, 3.0, 0.7, states_in_a_row=20)
        clock = client.state().bridge_clock
        pids = [state.processes[name].pid for name in ("loop", "recorder")]
        run_dir = RunDir(wire.daemon.config.bench.name, wire.daemon.folder / "motord")
        ring, tripped = RingReader(run_dir.ring), []
        alive_ns = time.time_ns()
        os.kill(wire.daemon.ready["pid"], signal.SIGKILL)
        killed_ns = time.time_ns()
        until(lambda: stays_tripped(ring, tripped) or not psutil.pid_exists(pids[0]), "the trip")
        go_on(wire.devices)
        with suppress(ProcessLookupError):  # it leaves by itself 5 s after its supervisor
            os.kill(pids[0], signal.SIGTERM)
        until(lambda: not any(map(psutil.pid_exists, pids)), "the loop's end, and its last ticks")
    assert clock is not None
    assert abs(clock.drift_ppm) <= DRIFT_MAX * 1e6  # a computer that stalls shows no better
    assert clock.jitter_us > 0.0
    ticks = wire.daemon.runs()[-1].ticks()
    check_held_speed(ticks, begun, state)
    ramped_ns = killed_ns + round((STALE_S + RAMP_S) * 1e9)
    commanded = np.max([np.abs(ticks[f"i_cmd_{phase}_A"]) for phase in "abc"], axis=0) > 0
    tick_ns = (ticks["t_ns"] + ticks["sample_age_ns"]).astype(np.int64)
    last_ns = tick_ns[commanded][-1]
    since_ns = np.diff(tick_ns[(tick_ns > alive_ns) & (tick_ns <= last_ns)])
    stalled_ns = max(since_ns.max() - 1e9 / wire.daemon.config.loop.rate_Hz, 0)
    assert last_ns <= ramped_ns + stalled_ns
    ramping = np.flatnonzero(ticks["torque_set_Nm"] > 0)[-1]  # zero in the next tick, then tripped
    assert ticks["state"][ramping] == State.ENABLED
    assert ticks["state"][ramping + 1] in (State.ENABLED, State.TRIPPED)
    after = ticks[ramping + 2 :]
    assert len(after) > 100
    assert (after["state"] == State.TRIPPED).all()
    truth = wire.truth()
    then = (truth["t_ns"] > begun.tick.t_ns) & (truth["t_ns"] < state.tick.t_ns)
    check_torque(truth[then], wire.daemon.config.motor, 3.0, 0.04)
    zero_ns = int(after["t_ns"][0] + after["sample_age_ns"][0])
    assert currents(truth, zero_ns, DECAYED_S).max() < ZERO_A


def test_a_daemon_without_its_devices_says_which(tmp_path):
    soon = "[brake.modbus]\nconnect_timeout_s = 0.1\n"
    bench = write_bench(tmp_path, {"[brake.modbus]\n": soon})
    brake = Program(tmp_path, "run", "-c", bench, ready=False)
    assert brake.wait() == 1
    assert brake.said().splitlines()[-1].startswith("motord: [brake.modbus] 127.0.0.1")
    bench.write_text(bench.read_text().replace('driver = "modbus"', 'driver = "none"'))
    board = Program(tmp_path, "run", "-c", bench, ready=False)
    assert board.wait() == 1
    last = board.said().splitlines()[-1]
    assert "bridge: cannot open" in last
    assert "is the board plugged in" in last
