"""The calibration in force, and the processes that estimate and track calibrations."""

import signal

import pytest

from motord.sequencing.settings import COMPENSATE
from tests.support import early_end
from tests.support.calibrations import calibration, put_in_force
from tests.unit.service.played_daemon import PlayedDaemon


def test_an_installed_calibration_is_in_force_from_the_start(tmp_path, monkeypatch):
    folder = tmp_path / "calibrations" / "played"
    folder.mkdir(parents=True)
    given = calibration()
    given.save(folder / "x.json")
    (folder / "installed").write_text("x.json\n")
    played = PlayedDaemon(tmp_path, monkeypatch)
    played.up()
    assert played.state()["calibration"]["id"] == given.id
    assert played.loops[0].tables.current.parameters["alpha"][0] == pytest.approx(given.alpha)
    assert played.supervisor.bench.setpoint.compensate == COMPENSATE["on"]
    assert played.record()["metadata"]["calibration"] == given.id
    played.close()


def test_an_installed_calibration_that_is_broken_is_reported_and_left_out(tmp_path, monkeypatch):
    folder = tmp_path / "calibrations" / "played"
    folder.mkdir(parents=True)
    (folder / "installed").write_text("gone.json\n")
    played = PlayedDaemon(tmp_path, monkeypatch)
    played.up()
    assert played.state()["calibration"] is None
    assert any("gone.json" in m for m in played.messages())
    played.close()


def test_the_estimator_of_a_plan_lasts_as_long_as_the_plan(played):
    played.up()
    bench = played.supervisor.bench
    assert played.estimators == []
    bench.plans.start(early_end.make(played.config, {}), "anna", "", detached=True)
    played.step(2)
    [estimator] = played.estimators
    [start] = estimator.received()
    assert start["estimator"] == "tests.support.early_end:Estimator"
    known = {"half_widths": {early_end.QUANTITY: 0.5}, "obstacle": "", "captures": 2}
    estimator.send({"run": start["run"], **known})
    played.step(20)
    plan = played.state()["plan"]
    assert (plan["precision"], plan["targets"]) == ({"x_percent": 0.5}, {"x_percent": 0.0})
    assert played.state()["processes"]["estimator"]["running"]
    bench.stop("by a test")
    played.step(20)
    assert estimator.signals == [signal.SIGKILL]
    assert "estimator" not in played.state()["processes"]
    assert not any("estimator" in said for said in played.messages())


def test_the_loss_of_an_estimator_is_an_event_and_the_plan_goes_on(played):
    played.up()
    bench = played.supervisor.bench
    bench.plans.start(early_end.make(played.config, {}), "anna", "", detached=True)
    played.step(2)
    played.estimators[0].code = -signal.SIGKILL
    played.step(20)
    assert (
        "estimator ended: killed by SIGKILL: the plan under way goes on and does not end early"
        in played.messages()
    )
    assert "has ended" in played.state()["plan"]["obstacle"]
    assert bench.plans.active
    assert len(played.estimators) == 1


def test_the_estimator_ends_with_the_daemon(played):
    played.up()
    played.supervisor.bench.plans.start(early_end.make(played.config, {}), "a", "", detached=True)
    played.step(2)
    played.supervisor.take_down()
    assert played.estimators[0].signals == [signal.SIGKILL]


def test_a_calibration_is_tracked_where_that_is_enabled(tmp_path, monkeypatch):
    played = PlayedDaemon(tmp_path, monkeypatch, tracking={"enabled": True})
    played.up()
    played.step(20)
    assert (played.trackers, played.state()["tracking"]) == ([], None)
    in_force = played.supervisor.publisher.calibrations
    put_in_force(in_force, calibration())
    played.step(20)
    [tracker] = played.trackers
    [start] = tracker.received()
    assert start["calibration"] == str(in_force.path)
    tracker.send(
        {
            "tracked": {
                "calibration": in_force.current_id(), "t_ns": 1, "turns": 9, "memory_s": 300.0,
                "quantities": [], "unseen": [], "obstacle": "",
            }
        }
    )  # fmt: skip
    played.step(20)
    assert played.state()["tracking"]["turns"] == 9
    played.supervisor.take_down()
    assert tracker.signals == [signal.SIGKILL]
    played.close()


def test_a_calibration_is_not_tracked_unless_that_is_enabled(played):
    played.up()
    put_in_force(played.supervisor.publisher.calibrations, calibration())
    played.step(20)
    assert (played.trackers, played.state()["tracking"]) == ([], None)
