"""Tracking of the calibration in force by a daemon, whose tracker is killed."""

import os
import signal

import pytest

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
def running(folder):
    path = write_sim(folder, lease_s=LONG_LEASE_S)
    path.write_text(f"{path.read_text()}\n[tracking]\nenabled = true\nmemory_s = 30.0\n")
    with daemon(folder, path) as program:
        yield program


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
