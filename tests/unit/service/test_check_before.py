"""A check of the calibration before a plan: what it lets begin, and what not."""

import json
from pkgutil import resolve_name

import numpy as np
import pytest

from motord.api.errors import RpcError
from motord.config import load
from motord.experiments.check_calibration import plan
from motord.schema import State
from motord.sequencing.observation import Precision
from motord.virtual import VirtualBench
from tests.campaigns.check_calibration import stated_calibration, with_drift
from tests.campaigns.estimator import rig
from tests.unit.service.test_operate import trip
from tests.unit.service.virtual_service import VirtualService

SEED = 1
CHECK, PLAN = "check-calibration", "verify"
POINT = {"torques_Nm": [2.0], "speeds_Hz": [0.9], "turns": 2, "settle_s": 0.2}


class EstimatorInProcess:
    """In the place of the link and its process: the real estimator, its answers at once."""

    def __init__(self, service):
        self._config, self._run, self._ticks = service.config, service.loop.run, []
        self._estimator = self.precision = None
        service.loop.run = self._watched

    def _watched(self):
        self._ticks.append(self._run())
        return self._ticks[-1]

    def begin(self, plan):
        self.precision = self._estimator = None
        if plan.estimator:
            options = json.loads(json.dumps(plan.estimator_options))
            made = resolve_name(plan.estimator)
            self._estimator = made(self._config, plan.targets, **options)

    def captured(self, point):
        ticks = np.concatenate(self._ticks)
        self._ticks = []
        if self._estimator is not None:
            self._estimator.take(ticks[ticks["plan_point"] >= 0])
            self.precision = self._estimator.captured(point)

    def end(self):
        self._estimator = None


class Played:
    """An estimator that finds what a test says, once so many points are captured."""

    def __init__(self, obstacle="", points=3, evaluated=3):
        self.precision, self._left = None, points
        self._found = Precision(evaluated, obstacle=obstacle)

    def begin(self, plan):
        self.precision = None

    def captured(self, point):
        self._left -= 1
        if self._left <= 0:
            self.precision = self._found

    def end(self):
        pass


def service_with(tmp_path, drift=0.0, **changes):
    """Return a calibrated bench that is to be checked before plans, phase b's gain off by drift."""
    config = load()
    calibration = stated_calibration(SEED, config)
    calibration.save(tmp_path / "c.json")
    virtual = VirtualBench(config, with_drift(rig(SEED)[0], 1, drift), SEED, calibration)
    asked = {"calibration": {"check_before_plans": True}}
    service = VirtualService(virtual=virtual, **{**asked, **changes})
    service.calibration_file = tmp_path / "c.json"
    service.bench.calibration_installed()
    service.bench.plans.estimator = Played()
    return service


@pytest.fixture
def service(tmp_path):
    return service_with(tmp_path)


def start(service, name=PLAN, settings=POINT, **arguments):
    """Start a plan, detached, by a request; return the answer."""
    token = service.acquire(force=True)
    asked = {"name": name, "settings": settings, "token": token, "detach": True, **arguments}
    return service.ask("plan/start", **asked)


def to_the_end(service):
    """Let a plan run to its end; return the views on the way, the last one included."""
    seen = []
    while service.bench.plans.active:
        service.step()
        seen.append(service.bench.plans.view)
    return seen


def begun(service):
    """Return which recordings were begun, by plan."""
    return [one.name for one, _, _ in service.sink.started]


def step_until(service, text):
    """Let time pass until the plan's step has a text in it."""
    for _ in range(5000):
        service.step()
        if text in service.bench.plans.view.step:
            return
    raise AssertionError(service.bench.plans.view)


def test_a_plan_begins_once_the_calibration_was_found_to_hold(tmp_path):
    service = service_with(tmp_path)
    service.bench.plans.estimator = EstimatorInProcess(service)
    run_id = start(service)["run_id"]
    seen = to_the_end(service)
    assert {(view.plan, view.run_id, view.points) for view in seen} == {(PLAN, run_id, 1)}
    assert [view.over for view in seen].index(True) == len(seen) - 1
    assert (seen[-1].state, seen[-1].points_done, seen[-1].message) == ("done", 1, "")
    assert begun(service) == [CHECK, PLAN]
    assert seen[0].recording == f"/runs/{CHECK}.mcap"
    assert seen[-1].recording == f"/runs/{PLAN}.mcap"
    assert any("check of the calibration before it: " in view.step for view in seen)
    assert [point["index"] for point in service.sink.points] == [0, 1, 2, 0]
    checked = f"plan: {PLAN} begins, the calibration was checked: valid: calibration"
    assert any(message.startswith(checked) for message in service.messages())
    assert service.journal.log.plan.name == PLAN
    assert service.journal.log.taken == {0}


def test_a_plan_does_not_begin_after_a_drift(tmp_path):
    service = service_with(tmp_path, drift=0.006)
    service.bench.plans.estimator = EstimatorInProcess(service)
    start(service)
    last = to_the_end(service)[-1]
    assert (last.plan, last.state, last.points_done) == (PLAN, "failed", 0)
    assert "no longer holds: the gain of phase b" in last.message
    assert "% (limit 0." in last.message
    assert "calibrate again, or start without the check" in last.message
    assert begun(service) == [CHECK]
    assert service.sink.over[-1].state == "failed"
    assert service.bench.state is State.READY
    with pytest.raises(RpcError, match="none was interrupted"):
        service.ask("plan/resume", token=service.acquire(force=True))


@pytest.mark.parametrize(
    ("estimator", "why"),
    [
        (Played("the estimator process has ended"), "the estimator process has ended; calibrate"),
        (Played("early", points=1), "early; calibrate again"),
        (Played(evaluated=2), "not evaluated within 0.5 s"),
        (None, "not evaluated within 0.5 s"),
    ],
)
def test_a_check_that_cannot_be_evaluated_lets_nothing_begin(service, estimator, why, monkeypatch):
    monkeypatch.setattr(plan, "EVALUATED_S", 0.5)
    service.bench.plans.estimator = estimator
    start(service)
    last = to_the_end(service)[-1]
    assert last.state == "failed"
    assert why in last.message
    assert begun(service) == [CHECK]


def test_a_plan_does_not_begin_with_the_check_of_another_calibration(service, tmp_path):
    token = service.acquire()
    asked = {"name": PLAN, "settings": POINT, "token": token, "detach": True}
    call = service.prepare("plan/start", **asked)
    service.calibration_file = tmp_path / "installed-meanwhile.json"
    with pytest.raises(RpcError, match="another calibration was installed meanwhile; ask again"):
        service.carry_out(call)
    assert begun(service) == []


@pytest.mark.parametrize("limits", [{"trip_speed_rad_s": 7.0}, {"torque_rate_Nm_per_s": 100.0}])
def test_a_check_that_does_not_fit_the_limits_is_named(tmp_path, limits):
    """A reversal of the torque in a tenth of a second would trip the bench."""
    service = service_with(tmp_path, limits=limits)
    with pytest.raises(RpcError, match=r"the check of the calibration before it .*--no-check.*: "):
        start(service, settings={**POINT, "speeds_Hz": [0.3]})


def test_a_plan_can_be_started_without_the_check(service):
    start(service, check=False)
    assert to_the_end(service)[-1].state == "done"
    assert begun(service) == [PLAN]


@pytest.mark.parametrize(
    ("name", "settings", "changes"),
    [
        (PLAN, POINT, {"calibration": {"check_before_plans": False}}),
        (PLAN, {**POINT, "compensate": "off"}, {}),
        ("calibrate", {**POINT, "gain_steps": []}, {}),
        (CHECK, {}, {}),
    ],
)
def test_plans_that_do_not_rest_on_the_calibration_are_not_checked(
    tmp_path, name, settings, changes
):
    service = service_with(tmp_path, **changes)
    start(service, name, settings)
    assert begun(service) == [name]
    assert f"plan: {name} started by anna, detached" in service.messages()


def test_a_dry_run_counts_the_check(service):
    checked, alone = (
        service.ask("plan/start", name=PLAN, settings=POINT, dry_run=True, check=check)
        for check in (True, False)
    )
    assert "the calibration is checked first, about" in checked["outlook"]
    assert alone["outlook"] == ""
    assert 5.0 < checked["estimate_s"] - alone["estimate_s"] <= 10.0
    assert checked["points"] == alone["points"]


@pytest.mark.parametrize("step", ["capturing", "evaluating"])
@pytest.mark.parametrize("how", ["abort", "stop"])
def test_who_ends_the_check_ends_the_plan(service, step, how):
    service.bench.plans.estimator = Played(points=4)
    start(service)
    step_until(service, step)
    if how == "abort":
        service.ask("plan/abort", token=service.acquire(force=True))
    else:
        service.ask("stop", by="a test")
    last = to_the_end(service)
    view = last[-1] if last else service.bench.plans.view
    assert (view.plan, view.state) == (PLAN, "aborted")
    service.run_s(1.0)
    assert begun(service) == [CHECK]
    assert not service.bench.plans.active


def test_a_pause_while_it_is_evaluated_holds_the_plan_back(service):
    service.bench.plans.estimator = estimator = Played(points=4)
    start(service)
    step_until(service, "evaluating")
    token = service.acquire(force=True)
    service.ask("plan/pause", token=token)
    estimator.precision = Precision(3)
    service.run_s(1.0, token)
    assert service.bench.plans.view.state == "paused"
    assert begun(service) == [CHECK]
    service.ask("plan/resume", token=token, detach=True)
    service.run_s(0.1, token)
    assert begun(service) == [CHECK, PLAN]


def test_a_trip_in_the_check_fails_the_plan(service):
    start(service)
    step_until(service, "capturing")
    trip(service)
    last = to_the_end(service)[-1]
    assert (last.plan, last.state) == (PLAN, "failed")
    cause = "the bench tripped: OVER_SPEED (step: 5.1 Nm, about 1.4 Hz: capturing)"
    assert last.message == f"check of the calibration before it: {cause}"
    assert begun(service) == [CHECK]


def test_without_a_file_of_the_calibration_nothing_begins(service):
    service.calibration_file = None
    with pytest.raises(RpcError, match="cannot be checked before; ask again"):
        start(service)
    assert start(service, check=False)["plan"] == PLAN


def test_the_rest_of_a_plan_before_is_forgotten_with_the_check(service):
    start(service, settings={**POINT, "speeds_Hz": [0.9, 1.0]}, check=False)
    step_until(service, "capturing")
    service.ask("plan/abort", token=service.acquire(force=True))
    to_the_end(service)
    assert service.resumption.summary()
    start(service)
    assert service.resumption.summary() == ""
