"""Tracking of the calibration in force by a daemon, whose tracker is killed."""

import os
import signal
from functools import partial
from pathlib import Path

import pytest

from motord.api.requests import NOTHING_DEPARTED
from motord.client import ClientError
from tests.support.patience import PATIENCE_S
from tests.system.daemons import (
    LONG_LEASE_S,
    daemon,
    forgive,
    stalls_from_now,
    wait_until,
    write_sim,
)
from tests.unit.service.test_installation import calibration

pytestmark = [pytest.mark.system, pytest.mark.slow]


@pytest.fixture(scope="module")
def bench_path(folder):
    path = write_sim(folder, lease_s=LONG_LEASE_S)
    path.write_text(f"{path.read_text()}\n[tracking]\nenabled = true\nmemory_s = 30.0\n")
    return path


@pytest.fixture(scope="module")
def running(folder, bench_path):
    with daemon(folder, bench_path) as program:
        yield program


TURNS = 5
"""Turns at each torque: of several windows of the tracker."""


def tracked(client):
    """Return what is tracked, once there is something to it."""
    view = client.state().tracking
    return view if view is not None and view.turns > 0 else None


def pid_of_tracker(client):
    return client.state().processes["tracker"].pid


def kill_tracker(client, lease):
    """Lose the tracker while it tracks, again after a trip that a stall explains; return the state.

    `restarts` of the state is how often it took.
    """
    while True:
        kept = stalls_from_now(client)
        lease.reset()
        lease.set(enable=True, torque_Nm=2.0, speed_Hz=1.0)
        wait_until(lambda: tracked(client) or client.state().first_trip, "turns that are tracked")
        pid = pid_of_tracker(client)
        with client.subscribe_state() as states:  # the first of the next one: before its turns
            os.kill(pid, signal.SIGKILL)
            while (state := states.get(PATIENCE_S)).processes["tracker"].pid in (pid, None):
                pass
        if state.state == "ENABLED":
            return state
        forgive(client, kept)


def test_a_calibration_is_tracked_and_losing_the_tracker_costs_nothing_but_that(client):
    assert client.state().tracking is None
    assert "tracker" not in client.state().processes
    with client.lease("anna") as lease:
        with pytest.raises(ClientError, match="no calibration is in force"):
            lease.adopt_calibration()
        given = calibration()
        lease.install_calibration(given)
        state = kill_tracker(client, lease)
        assert (state.tracking.calibration, state.tracking.turns) == (given.id, 0)
    said = [event.message for event in client.events() if event.kind == "process"]
    assert len(said) == state.processes["tracker"].restarts
    for message in said:
        assert message.startswith("tracker ended: killed by SIGKILL: tracking of the calibration b")


def test_what_is_tracked_is_adopted_and_in_force_after_a_kill(folder, bench_path, client, running):
    with client.lease("anna") as lease:
        lease.install_calibration(calibration())
        adopted = adopt(client, lease)
    state = client.state()
    assert state.calibration.id == adopted.id
    assert Path(adopted.path).stem == adopted.id
    os.kill(running.process.pid, signal.SIGKILL)
    running.process.wait(PATIENCE_S)
    with daemon(folder, bench_path) as next_one, next_one.connect() as again:
        assert again.state().calibration.id == adopted.id


def adopt(client, lease):
    """Hold torques until what is tracked can be adopted; return the calibration that is in force.

    What a trip that a stall explains has cost is turned again.
    """
    turns = 0
    while True:
        kept = stalls_from_now(client)
        lease.reset()
        for torque_Nm in (2.0, 4.0, 6.0):
            lease.set(enable=True, torque_Nm=torque_Nm, speed_Hz=1.0)
            turns += TURNS
            wait_until(partial(enough_or_tripped, client, turns), "more turns")
        if client.state().first_trip:
            turns = 0
            forgive(client, kept)
            continue
        lease.disable()
        try:
            return lease.adopt_calibration(accept=[NOTHING_DEPARTED])
        except ClientError as error:
            if "nothing to adopt" not in str(error):
                raise


def enough_or_tripped(client, turns):
    view = tracked(client)
    return (view is not None and view.turns >= turns) or client.state().first_trip
