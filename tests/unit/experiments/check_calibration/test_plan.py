"""The plan of a check: its points, its time, and what becomes of it if it is interrupted."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from motord.config import load
from motord.config.faults import Fault, Timeline
from motord.control.types import SETPOINT
from motord.experiments.plans import build
from motord.schema import Compensate, State
from motord.sequencing import Demand, Executor, PlanError, PlanState, TickWatcher
from motord.sequencing.brake_servo import brake_torque_Nm
from motord.virtual import VirtualBench, run_plan
from motord.virtual.plan import PlanFailed, _put
from motord.virtual.preflight import forecasts
from tests.campaigns.check_calibration import stated_calibration
from tests.campaigns.estimator import rig


def bench(faults: Timeline | None = None) -> VirtualBench:
    config = load()
    return VirtualBench(config, rig(1)[0], 1, stated_calibration(1, config), faults)


def braked_Nm(speed_Hz: float) -> float:
    """Return the brake's torque at a speed, fully excited."""
    return brake_torque_Nm(load().brake, 1.0, 2 * np.pi * speed_Hz)


def test_points_are_equal_then_one_phase_scaled_then_backwards() -> None:
    plan = build("check-calibration", load())
    first, scaled, back = plan.points
    assert first.torque_Nm == scaled.torque_Nm == -back.torque_Nm == pytest.approx(5.1)
    assert first.speed_Hz == -back.speed_Hz > scaled.speed_Hz
    assert scaled.induced.gain == (0.6, 1.0, 1.0)
    assert [point.turns for point in plan.points] == [3, 2, 3]
    assert plan.settings["compensate"] == "calibration"


def test_forwards_takes_half_the_torque_instead_of_turning_back() -> None:
    first, _, last = build("check-calibration", load(), {"directions": "forwards"}).points
    assert last.torque_Nm == pytest.approx(2.55)
    assert braked_Nm(last.speed_Hz) / braked_Nm(first.speed_Hz) == pytest.approx(0.5)


def test_a_phase_scaled_less_leaves_the_rotor_faster() -> None:
    first, scaled, _ = build("check-calibration", load(), {"scaled_gain": 0.8}).points
    assert scaled.induced.gain == (0.8, 1.0, 1.0)
    assert braked_Nm(scaled.speed_Hz) / braked_Nm(first.speed_Hz) == pytest.approx(2.8 / 3)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"compensate": "off"}, "compensate is always calibration"),
        ({"torque_Nm": 9.0}, "limits. torque_Nm"),
        ({"speed_Hz": 9.0}, "trip_speed_rad_s"),
        ({"turns": 2}, "turns"),
        ({"mesh": 2}, "settings are: .*torque_Nm.*compensate"),
    ],
)
def test_what_tests_nothing_or_cannot_be_held_is_refused(settings: dict, expected: str) -> None:
    with pytest.raises(PlanError, match=expected):
        build("check-calibration", load(), settings)


def test_it_takes_ten_seconds_from_enable_to_done_with_the_calibration_applied() -> None:
    virtual, blocks = bench(), []
    plan = build("check-calibration", virtual.config)
    points = run_plan(virtual, plan, lambda ticks, _: blocks.append(ticks))
    ticks = np.concatenate(blocks)
    enabled_s = np.argmax(ticks["state"] == State.ENABLED) * 1e-3
    assert 8.0 < virtual.t_s - enabled_s <= 10.0
    assert plan.seconds == pytest.approx(virtual.t_s, abs=1.0)
    assert {point["compensate"] for point in points} == {Compensate.CURRENTS | Compensate.COGGING}
    assert [point["quality"] for point in points] == ["ok"] * 3
    assert len({point["brake"] for point in points}) == 1


def test_a_dry_run_takes_every_point() -> None:
    config = load()
    plan = build("check-calibration", config)
    with ThreadPoolExecutor(1) as pool:
        found = list(forecasts(config, plan, stated_calibration(1, config), pool, 1e6))
    assert [one.fine for one in found] == [True] * 3


def test_a_pause_in_mid_capture_takes_the_point_again_at_the_same_brake() -> None:
    virtual = bench()
    executor, watcher = Executor(build("check-calibration", virtual.config)), TickWatcher()
    setpoint = np.zeros(1, SETPOINT)
    setpoint["plan_point"] = -1
    demand = Demand()
    paused = 0
    for _ in range(600):
        seen = watcher.take(virtual.run(setpoint, 50)[0])
        if not paused and seen.plan_point == 1 and seen.point_turns > 1.0:
            executor.pause()
        paused += executor.state is PlanState.PAUSED
        if paused == 3:
            executor.resume()
        before, demand = demand, executor.advance(seen)
        _put(setpoint, before, demand)
        if executor.finished:
            break
    assert executor.state is PlanState.DONE
    assert paused >= 3
    assert [point["index"] for point in executor.points] == [0, 1, 2]
    assert [point["quality"] for point in executor.points] == ["ok"] * 3
    assert 2.0 <= executor.points[1]["turns"] < 2.2
    assert len({point["brake"] for point in executor.points}) == 1


def test_a_trip_in_mid_capture_ends_it_and_it_can_be_started_again() -> None:
    virtual = bench(Timeline(fault=(Fault(kind="inverter_fault", at_s=2.0),)))
    plan = build("check-calibration", virtual.config)
    with pytest.raises(PlanFailed, match="check-calibration: the bench tripped"):
        run_plan(virtual, plan, lambda *_: None)
    again = bench()
    assert len(run_plan(again, plan, lambda *_: None)) == 3
