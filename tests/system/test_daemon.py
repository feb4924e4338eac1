"""`motord run` with the simulated bench: processes, sockets and files as a user has them."""

import subprocess
from itertools import pairwise

import numpy as np
import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.client import ClientError
from motord.schema import Flag, State
from motord.sequencing.capture import final
from motord.sequencing.quality import GOOD
from motord.service.recording.control import BEFORE_S
from tests.support.patience import PATIENCE_S, until
from tests.system.daemons import Program, daemon, leave_at_rest, wait_for, write_sim

pytestmark = [pytest.mark.system, pytest.mark.slow]

SHORT_PLAN = {
    "torques_Nm": [2.0], "speeds_Hz": [0.8, 1.0], "turns": 2, "settle_s": 0.2, "gain_steps": [],
}  # fmt: skip


def turning(torque_Nm, speed_Hz, tolerance=0.1):
    """Return whether a state has both; which of them comes first is up to the rig."""
    return lambda s: (
        s.tick is not None
        and s.tick.torque_set_Nm == torque_Nm
        and abs((s.tick.speed_Hz or 0) - speed_Hz) < tolerance
    )


def rest(client):
    """Wait until a recording that begins has nothing of what was before."""
    begun_s = client.state().uptime_s
    wait_for(
        client,
        lambda s: s.uptime_s > begun_s + 2 * BEFORE_S and not s.recording.recording,
        "a bench that rested",
    )


def check_ticks(ticks):
    """Every tick once, in order, and as many gaps as the loop says that it missed."""
    numbers, missed = ticks["tick"].astype(int), ticks["missed"].astype(int)
    steps = np.diff(numbers)
    assert (steps >= 1).all()
    unexplained = np.flatnonzero(steps - 1 != np.diff(missed))
    assert not unexplained.size, [tuple(ticks[row : row + 2]) for row in unexplained[:10]]
    late = ticks["flags"][1:] & Flag.AFTER_GAP > 0
    assert np.array_equal(late, steps > 1)


def check_takes(takes):
    """Takes of a point are numbered, and each but the last was poor."""
    for take, following in pairwise(takes):
        if final(take):
            assert (following["index"], following["take"]) == (take["index"] + 1, 1)
        else:
            assert take["quality"] != GOOD
            assert (following["index"], following["take"]) == (take["index"], take["take"] + 1)


@pytest.fixture(scope="module")
def lasting(folder):
    """A daemon that outlives its loops, recorded as they ran."""
    with daemon(folder, write_sim(folder)) as program:
        yield program
        assert program.end() == 0
        for run in program.runs():
            check_ticks(run.ticks(("tick", "missed", "flags")))


@pytest.fixture
def outlived(lasting):
    """A daemon that is OFF, and is so again after the test."""
    yield lasting
    with lasting.connect() as client:
        leave_at_rest(client)


def test_a_run_by_hand_from_enable_to_stop(outlived):
    streamed = []
    with outlived.connect() as client, client.subscribe_ticks(streamed.append) as subscription:
        if outlived.runs():
            rest(client)
        before = len(outlived.runs())
        assert client.state().state == "OFF"
        with client.lease("anna") as lease:
            assert client.rpc("enable", token=lease.token) == {"state": "ENABLED"}
            client.rpc("set", token=lease.token, torque_Nm=2.0, speed_Hz=0.7)
            wait_for(client, turning(2.0, 0.7), "2 Nm at 0.7 Hz")
            wait_for(client, lambda s: s.recording.recording, "the recorder to say so")
            assert client.rpc("disable", token=lease.token) == {"state": "READY"}
            assert client.rpc("stop") == {"state": "OFF"}
            stopped = client.state()
            until(lambda: streamed and streamed[-1]["tick"][-1] >= stopped.tick.tick, "the ticks")
        lost_ticks = subscription.lost_ticks
        wait_for(client, lambda s: not s.recording.recording, "the recording to end")
    [run] = outlived.runs()[before:]
    assert run.damage is None
    ticks = run.ticks()
    check_ticks(ticks)
    assert {State.OFF, State.READY, State.ENABLED} <= set(ticks["state"])
    assert ticks["torque_set_Nm"].max() == pytest.approx(2.0)
    assert State(int(ticks["state"][-1])) is State.OFF
    assert ticks["state"][0] == State.OFF
    live = np.concatenate(streamed)
    assert {State.OFF, State.READY, State.ENABLED} <= set(live["state"])
    # the first ticks may come before the recording, the last ones after it
    live = live[(live["tick"] >= ticks["tick"][0]) & (live["tick"] <= ticks["tick"][-1])]
    meanwhile = (ticks["tick"] >= live["tick"][0]) & (ticks["tick"] <= live["tick"][-1])
    assert len(live) + lost_ticks >= meanwhile.sum()  # nothing is lost without being counted
    assert lost_ticks < 0.5 * meanwhile.sum()
    assert np.isin(live["tick"], ticks["tick"]).all()
    assert (np.diff(live["tick"].astype(int)) >= 1).all()
    kinds = [event["kind"] for event in run.events()]
    assert {"lease", "request", "state"} <= set(kinds)
    names = [state["state"] for state in run.states()]
    assert names[0] == "OFF"
    assert "ENABLED" in names
    assert names[-1] == "OFF"
    assert {"anna", ""} == {state["holder"] for state in run.states()}
    assert run.metadata["bench"] == "system"
    assert "[motor]" in run.metadata["config"]


def test_malformed_benches_are_exit_1_and_a_line_for_each_thing_that_is_wrong(tmp_path):
    path = write_sim(tmp_path)
    path.write_text(path.read_text().replace("pole_pairs = 8", "pole_pair = 8"))
    done = CliRunner().invoke(app, ["run", "-c", str(path)])
    assert done.exit_code == 1
    missing, unknown = done.stderr.splitlines()
    assert "motor.pole_pairs: missing" in missing
    assert "motor.pole_pair: unknown key; did you mean pole_pairs?" in unknown


def test_a_bench_is_run_once_at_a_time(outlived, folder):
    second = Program(folder, "run", "-c", folder / "system.toml", ready=False)
    assert second.wait() == 1
    assert "is in use" in second.said()
    assert str(outlived.process.pid) in second.said()


def test_a_plan_is_recorded_with_its_points_in_a_file_of_its_own(outlived):
    before = len(outlived.runs())
    with outlived.connect() as client, client.subscribe_plan() as progress:
        with client.lease("anna") as lease:
            client.rpc(
                "plan/start", token=lease.token, name="calibrate", settings=SHORT_PLAN,
                detach=True, notes="a short one",
            )  # fmt: skip
        wait_for(client, lambda s: s.recording.recording, "the recording to begin")
        noted = client.rpc("note", text="fan switched on", by="anna")
        view = progress.get(PATIENCE_S)
        while not view.over:
            view = progress.get(PATIENCE_S)
        assert (view.state, view.points_done) == ("done", 2)
        wait_for(client, lambda s: not s.recording.recording, "the recording to end")
        mesh = client.mesh()
    runs = outlived.runs()[before:]
    [plan_run] = [run for run in runs if run.metadata["plan"]]
    assert str(plan_run.path) == view.recording
    assert plan_run.metadata["plan"]["name"] == "calibrate"
    assert "a short one" in plan_run.metadata["notes"]
    assert noted["recording"] == view.recording
    [note] = [event for event in plan_run.events() if event["kind"] == "note"]
    assert (note["message"], note["t_ns"]) == ("fan switched on", noted["t_ns"])
    takes = plan_run.operating_points()
    points = [take for take in takes if final(take)]
    assert [p["index"] for p in points] == [0, 1]
    check_takes(takes)
    assert [(p.point, p.state, p.rms_error_percent) for p in mesh.points] == [
        (p["index"], "done" if p["quality"] == GOOD else "poor", p["rms_error_percent"])
        for p in points
    ]
    ticks = plan_run.ticks(("tick", "plan_point", "missed", "flags"))
    check_ticks(ticks)
    for point in takes:
        inside = (ticks["tick"] >= point["tick_start"]) & (ticks["tick"] <= point["tick_end"])
        assert (ticks["plan_point"][inside] == point["index"]).all()
    numbers = np.concatenate([run.ticks(("tick",))["tick"] for run in runs])
    assert (np.diff(numbers.astype(int)) >= 1).all()


def test_a_trip_is_shown_until_reset_though_its_loop_has_ended(outlived):
    with outlived.connect() as client, client.lease("anna") as lease:
        client.rpc("enable", token=lease.token)
        client.rpc("set", token=lease.token, torque_Nm=3.0, brake=0.0)  # it runs away
        trip = wait_for(client, lambda s: s.state == "TRIPPED", "a trip").trip
        subprocess.run(["kill", "-9", str(client.state().processes["loop"].pid)], check=True)
        state = wait_for(client, lambda s: s.fault, "the fault")
        assert (state.state, state.first_trip) == ("TRIPPED", "OVER_SPEED")
        assert (state.trip.t_ns, state.trip.blackbox) == (trip.t_ns, trip.blackbox)
        assert client.rpc("reset", token=lease.token) == {"state": "OFF"}
        state = wait_for(client, lambda s: s.tick is not None, "ticks")
        assert (state.state, state.first_trip, state.trip) == ("OFF", "", None)


def test_a_stopped_loop_is_ended_and_comes_back_off_after_reset(outlived):
    with outlived.connect() as client, client.lease("anna") as lease:
        client.rpc("enable", token=lease.token)
        stopped = client.state().processes["loop"].pid
        subprocess.run(["kill", "-STOP", str(stopped)], check=True)
        wait_for(client, lambda s: s.fault, "the fault")
        with pytest.raises(ClientError, match="publishes no ticks; `motord reset`"):
            client.rpc("set", token=lease.token, torque_Nm=1.0)
        assert client.rpc("reset", token=lease.token) == {"state": "OFF"}
        state = wait_for(client, lambda s: s.tick is not None, "ticks")
        assert (state.state, state.fault) == ("OFF", "")
        assert state.processes["loop"].pid != stopped
