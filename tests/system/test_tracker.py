"""Tracking of the calibration in force by a daemon, whose tracker is killed."""

import os
import signal

import pytest

from motord.client import ClientError
from tests.system.daemons import daemon, wait_until, write_sim
from tests.unit.service.test_installation import calibration

pytestmark = [pytest.mark.system, pytest.mark.slow]


@pytest.fixture(scope="module")
def running(folder):
    path = write_sim(folder)
    path.write_text(f"{path.read_text()}\n[tracking]\nenabled = true\nmemory_s = 30.0\n")
    with daemon(folder, path) as program:
        yield program


def tracked(client):
    """Return what is tracked, once there is something to it."""
    view = client.state().tracking
    return view if view is not None and view.turns > 0 else None


def test_a_calibration_is_tracked_and_losing_the_tracker_costs_nothing_but_that(client):
    assert client.state().tracking is None
    assert "tracker" not in client.state().processes
    with client.lease("anna") as lease:
        with pytest.raises(ClientError, match="no calibration is in force"):
            lease.adopt_calibration()
        given = calibration()
        lease.install_calibration(given)
        lease.set(enable=True, torque_Nm=2.0, speed_Hz=2.0)
        wait_until(lambda: tracked(client), "turns that are tracked")
        assert client.state().tracking.calibration == given.id
        pid = client.state().processes["tracker"].pid
        os.kill(pid, signal.SIGKILL)
        wait_until(lambda: client.state().processes["tracker"].pid not in (pid, None), "the next")
        state = client.state()
        assert (state.state, state.tracking.turns) == ("ENABLED", 0)
        assert state.processes["tracker"].restarts == 1
    [said] = [event.message for event in client.events() if event.kind == "process"]
    assert said.startswith("tracker ended: killed by SIGKILL: tracking of the calibration begins")
