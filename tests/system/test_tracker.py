"""Tracking of the calibration in force by a daemon, whose tracker is killed."""

import os
import signal
from pathlib import Path

import pytest

from motord.api.requests import NOTHING_DEPARTED
from motord.client import ClientError
from tests.support.calibrations import calibration
from tests.support.patience import PATIENCE_S
from tests.system.daemons import (
    daemon,
    forgive,
    stalls_from_now,
    wait_for,
    write_sim,
)

pytestmark = [pytest.mark.system, pytest.mark.slow]

TORQUE_NM = 4.0
SPEED_HZ = 2.3
"""More than two turns in a second, the shortest window of the tracker."""


@pytest.fixture(scope="module")
def running(folder):
    path = write_sim(folder)
    path.write_text(f"{path.read_text()}\n[tracking]\nenabled = true\nmemory_s = 30.0\n")
    with daemon(folder, path) as program:
        yield program


@pytest.fixture(scope="module")
def given(client):
    """Return a calibration that is in force, known so little that a few turns show more of it."""
    assert client.state().tracking is None
    assert "tracker" not in client.state().processes
    made = calibration(alpha_stderr=(0.05,) * 3, beta_stderr_A=(0.5,) * 3)
    with client.lease("anna") as lease:
        with pytest.raises(ClientError, match="no calibration is in force"):
            lease.adopt_calibration()
        lease.install_calibration(made)
    return made


def hold_until(client, lease, condition, what):
    """Hold a torque until a state fulfils `condition`, again after a trip that a stall explains."""
    while True:
        kept = stalls_from_now(client)
        lease.reset()
        lease.set(enable=True, torque_Nm=TORQUE_NM, speed_Hz=SPEED_HZ)
        state = wait_for(client, lambda state: state.first_trip or condition(state), what)
        if not state.first_trip:
            return state
        forgive(client, kept)


def has_turns(state):
    return state.tracking is not None and state.tracking.turns > 0


def gains_are_better(state):
    """Return whether the gains are tracked, each better than the calibration states it."""
    gains = [one for one in state.tracking.quantities if one.name.startswith("alpha-")]
    return any(one.adoptable for one in gains) and all(
        one.half_width < one.in_force_half_width for one in gains if one.adoptable
    )


def kill_tracker(client, lease):
    """Lose the tracker while it tracks, again after a trip that a stall explains; return the state.

    `restarts` of the state is how often it took.
    """
    while True:
        kept = stalls_from_now(client)
        pid = hold_until(client, lease, has_turns, "turns").processes["tracker"].pid
        with client.subscribe_state() as states:  # the first of the next one: before its turns
            os.kill(pid, signal.SIGKILL)
            while (state := states.get(PATIENCE_S)).processes["tracker"].pid in (pid, None):
                pass
        if state.state == "ENABLED":
            return state
        forgive(client, kept)


def test_a_calibration_is_tracked_and_losing_the_tracker_costs_nothing_but_that(client, given):
    with client.lease("anna") as lease:
        state = kill_tracker(client, lease)
    assert (state.tracking.calibration, state.tracking.turns) == (given.id, 0)
    said = [event.message for event in client.events() if event.kind == "process"]
    assert len(said) == state.processes["tracker"].restarts
    for message in said:
        assert message.startswith("tracker ended: killed by SIGKILL: tracking of the calibration b")


def test_what_is_tracked_is_adopted(client, given):
    with client.lease("anna") as lease:
        hold_until(client, lease, gains_are_better, "gains that can be adopted")
        lease.disable()
        adopted = adopt(lease)
    assert adopted.id != given.id
    state = client.state()
    assert state.calibration.id == adopted.id
    assert Path(adopted.path).stem == adopted.id


def adopt(lease):
    """Adopt what is tracked, however long a busy computer keeps the tracker from its reply."""
    while True:
        try:
            return lease.adopt_calibration(accept=[NOTHING_DEPARTED])
        except ClientError as error:
            if error.code != "timeout":
                raise
