"""A plan that ends early by what its estimator finds, and goes on when that is killed."""

import os
import signal
from pathlib import Path

import pytest

from tests.support.early_end import POINTS_WITHOUT, QUANTITY
from tests.support.patience import PATIENCE_S, until
from tests.system.daemons import daemon, write_sim
from tests.unit.experiments.external.test_external import announce

pytestmark = [pytest.mark.system, pytest.mark.slow]

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def running(folder):
    installed = folder / "installed"
    announce(installed, "early-end", early_end="tests.support.early_end:EXPERIMENT")
    paths = [str(installed), str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(paths))
        with daemon(folder, write_sim(folder)) as program:
            yield program


def followed(client, progress, condition):
    """Return the first progress of the plan, of those not read yet, that fulfils `condition`."""
    while True:
        view = progress.get(PATIENCE_S)
        assert view is not None, client.plan()
        if condition(view):
            return view


def messages(client, kind):
    return [event.message for event in client.events() if event.kind == kind]


def test_a_plan_ends_early_once_its_targets_are_reached(client):
    with client.lease("anna") as lease:
        view = lease.run_plan("early-end", {"x_percent": 0.2}).wait()
    assert (view.state, view.message) == ("done", "")
    assert 5 <= view.points_done < view.points
    assert view.targets == {QUANTITY: 0.2}
    assert view.precision[QUANTITY] <= 0.2
    assert view.obstacle == ""
    until(lambda: "estimator" not in client.state().processes, "its end")
    assert not messages(client, "process")


def test_a_plan_whose_estimator_is_killed_goes_on_to_its_end(client):
    with client.lease("anna") as lease:
        lease.start_plan("early-end", {"x_percent": 0.0})
        with client.subscribe_plan() as progress:
            begun = followed(client, progress, lambda view: view.over or view.precision)
            assert begun.state == "running"
            os.kill(client.state().processes["estimator"].pid, signal.SIGKILL)
            lost = followed(client, progress, lambda view: view.obstacle)
            assert "has ended" in lost.obstacle
            end = followed(client, progress, lambda view: view.over)
    assert (end.state, end.message) == ("done", "")
    assert lost.points_done + POINTS_WITHOUT - 1 <= end.points_done < end.points
    [said] = messages(client, "process")
    assert said.startswith("estimator ended: killed by SIGKILL: the plan under way goes on")


def test_a_plan_whose_estimator_is_stopped_waits_for_nothing(client):
    with client.lease("anna") as lease:
        lease.start_plan("early-end", {"points": 3000})
        with client.subscribe_plan() as progress:
            begun = followed(client, progress, lambda view: view.over or view.precision)
            pid = client.state().processes["estimator"].pid
            os.kill(pid, signal.SIGSTOP)
            further = begun.points_done + 30
            later = followed(client, progress, lambda view: view.points_done >= further)
            assert later.state == "running"
            assert client.state().processes["estimator"].pid == pid
            lease.abort_plan()
            assert followed(client, progress, lambda view: view.over).state == "aborted"
        until(lambda: not Path(f"/proc/{pid}").exists(), "the end of a stopped process")
