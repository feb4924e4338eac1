"""A plan whose daemon was killed, with everything that belongs to it, and goes on afterwards."""

import os
import signal
from collections import Counter

import numpy as np
import pytest

from motord.client import ClientError
from motord.identification.operating_points import split
from tests.support.patience import PATIENCE_S, until
from tests.system.daemons import daemon, journal, kill_everything, wait_for, write_sim

pytestmark = [pytest.mark.system, pytest.mark.slow]

PLAN = {
    "torques_Nm": [1.0, 2.0], "speeds_Hz": [0.8, 1.0], "turns": 2, "settle_s": 0.2,
    "gain_steps": [],
}  # fmt: skip
COLUMNS = ("tick", "t_ns", "plan_point", "missed", "encoder_count", "torque_Nm")


def journalled(folder):
    """Return how many points of the plan are on the disk: what was taken, once all are killed."""
    return journal(folder).count('"kind":"point"')


def followed(client, token, condition):
    with client.subscribe_plan() as progress:
        while True:
            view = progress.get(PATIENCE_S)
            assert view is not None, client.plan()
            if condition(view):
                return view


def points_of(runs):
    """Return index and number of ticks of each point that the analyses would use."""
    found = []
    for run in runs:
        ticks = run.ticks(COLUMNS)
        found += [
            (int(p.ticks["plan_point"][0]), len(p.ticks))
            for p in split(ticks, run.operating_points())
            if len(p.ticks)
        ]
    return found


@pytest.mark.long
def test_after_kill_9_of_everything_the_plan_takes_only_what_is_missing(tmp_path):
    path = write_sim(tmp_path)
    with daemon(tmp_path, path) as first, first.connect() as client:
        with client.lease("anna") as lease:
            client.rpc(
                "plan/start", token=lease.token, name="calibrate", settings=PLAN, detach=True
            )
        begun = followed(client, lease.token, lambda view: view.points_done >= 2)
        until(lambda: journalled(tmp_path) >= 2, "the disk")
        kill_everything(first, client)
    taken = journalled(tmp_path)
    assert taken < 4
    with daemon(tmp_path, path) as second:
        assert f"calibrate was interrupted with {taken} of 4 points taken" in second.said()
        with second.connect() as client, client.lease("ben") as lease:
            view = client.plan()
            assert (view.state, view.points_done, view.points) == ("interrupted", taken, 4)
            assert view.run_id == begun.run_id
            with pytest.raises(ClientError, match="plan resume"):
                client.rpc("plan/start", token=lease.token, name="calibrate", settings=PLAN)
            answer = client.rpc("plan/resume", token=lease.token, detach=True)
            assert answer["points"] == 4
            end = followed(client, lease.token, lambda view: view.over)
            assert (end.state, end.points_done) == ("done", 4)
            wait_for(client, lambda s: not s.recording.recording, "the recording to end")
        assert second.end() == 0
    assert not list((tmp_path / "runs").glob("*.part"))  # the next daemon has closed it
    runs = [run for run in second.runs() if run.metadata["plan"]]
    assert {run.metadata["plan"]["run_id"] for run in runs} == {begun.run_id}
    assert [run.metadata.get("recovered") for run in runs] == [None, "from the ring", None]
    assert runs[2].metadata["plan"]["continues"] == str(runs[0].path)
    found = points_of(runs)
    assert Counter(index for index, _ in found) == dict.fromkeys(range(4), 1)
    rate_Hz, slowest_Hz = second.config.loop.rate_Hz, 1.0
    assert min(ticks for _, ticks in found) > 0.5 * PLAN["turns"] / slowest_Hz * rate_Hz
    numbers = np.concatenate([run.ticks(("t_ns",))["t_ns"] for run in runs])
    assert (np.diff(numbers) > 0).all()


@pytest.mark.long
def test_what_a_recorder_that_died_has_lost_of_a_plan_is_taken_again(tmp_path):
    with daemon(tmp_path, write_sim(tmp_path)) as running:
        with running.connect() as client, client.lease("anna") as lease:
            client.rpc("plan/start", token=lease.token, name="calibrate", settings=PLAN)
            followed(client, lease.token, lambda view: view.points_done >= 1)
            os.kill(client.state().processes["recorder"].pid, signal.SIGKILL)
            end = followed(client, lease.token, lambda view: view.over)
            assert (end.state, end.points_done, end.recorded) == ("failed", 4, False)
            assert "the recorder died meanwhile" in end.message
            answer = client.rpc("plan/resume", token=lease.token)
            if answer["state"] != "done":  # something was lost
                followed(client, lease.token, lambda view: view.over)
            end = client.plan()
            assert (end.state, end.points_done) == ("done", 4)
            with pytest.raises(ClientError, match="none was interrupted"):
                client.rpc("plan/resume", token=lease.token)
        assert running.end() == 0
    found = points_of(run for run in running.runs() if run.metadata["plan"])
    whole = 0.5 * PLAN["turns"] * running.config.loop.rate_Hz
    assert {index for index, ticks in found if ticks > whole} == set(range(4))
