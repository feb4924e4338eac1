"""The executor and the mesh on a bench of first order."""

import itertools

import numpy as np
import pytest

from motord.config import BrakeConfig
from motord.config.experiments import plan_kinds
from motord.config.timing import ENABLE_MAX_S
from motord.experiments.plans import build
from motord.schema import State, Trip
from motord.sequencing import (
    Demand,
    Executor,
    OperatingPoint,
    Plan,
    PlanError,
    PlanState,
    TickWatcher,
)
from motord.sequencing.motions import Motion, enable, ramp_down
from tests.unit.control.bench import make_config
from tests.unit.sequencing.fakes import FakeBench

SMALL = {"torques_Nm": [1.0, 3.0], "speeds_Hz": [0.5, 1.0], "turns": 4, "settle_s": 0.5}


class Runner:
    def __init__(self, settings=None, brake_factor=1.0, name="verify", **sections) -> None:
        self.config = make_config(**sections)
        self.bench = FakeBench(self.config.brake, brake_factor)
        self.executor = Executor(build(name, self.config, settings or SMALL))
        self.watcher = TickWatcher()
        self.demand = Demand()
        self.marked: dict[int, list[int]] = {}

    def look(self) -> None:
        block = self.bench.look(self.demand)
        for row in block:
            self.marked.setdefault(int(row["plan_point"]), []).append(int(row["tick"]))
        self.demand = self.executor.advance(self.watcher.take(block))

    def until(self, condition, looks: int = 40_000) -> None:
        for _ in range(looks):
            self.look()
            if condition():
                return
        raise AssertionError(f"not reached: {self.executor.progress()}")

    def finish(self) -> None:
        self.until(lambda: self.executor.finished)


@pytest.mark.parametrize("brake_factor", [0.5, 1.0, 2.0])
def test_mesh_takes_every_point_at_its_speed(brake_factor: float) -> None:
    runner = Runner(brake_factor=brake_factor)
    runner.finish()
    assert runner.executor.state is PlanState.DONE
    points = runner.executor.points
    assert [(p["torque_Nm"], p["speed_Hz"]) for p in points] == [
        (1.0, 0.5), (1.0, 1.0), (3.0, 1.0), (3.0, 0.5),
    ]  # fmt: skip
    for point in points:
        assert point["quality"] == "ok"
        assert point["speed_mean_Hz"] == pytest.approx(point["speed_Hz"], rel=0.02)
        assert 4.0 <= point["turns"] < 4.2
    assert runner.bench.state is State.READY
    assert runner.demand.brake == 0.0


def test_points_name_exactly_the_ticks_that_carry_their_number() -> None:
    runner = Runner()
    runner.finish()
    for point in runner.executor.points:
        ticks = runner.marked[point["index"]]
        assert ticks == list(range(point["tick_start"], ticks[-1] + 1))
        assert 0 <= ticks[-1] - point["tick_end"] <= 2


def test_the_rotor_does_not_run_away_when_torque_steps_up() -> None:
    runner = Runner(settings={"torques_Nm": [5.0], "speeds_Hz": [1.0], "turns": 2, "settle_s": 0.1})
    runner.finish()
    assert runner.bench.fastest_rad_s < 9.0


def test_progress_grows_to_one() -> None:
    runner = Runner()
    fractions = []
    while not runner.executor.finished:
        runner.look()
        fractions.append(runner.executor.progress()["fraction"])
    assert all(b >= a - 1e-9 for a, b in itertools.pairwise(fractions))
    assert fractions[-1] == 1.0
    assert runner.executor.progress()["eta_s"] == 0.0
    elapsed_s = runner.executor.progress()["elapsed_s"]
    assert runner.executor.plan.seconds == pytest.approx(elapsed_s, rel=0.3)


def test_abort_ramps_down_and_disables() -> None:
    runner = Runner()
    runner.until(lambda: runner.demand.plan_point == 1)
    runner.executor.abort()
    runner.finish()
    assert runner.executor.state is PlanState.ABORTED
    assert runner.executor.message == "aborted by the operator"
    assert runner.bench.state is State.READY
    assert len(runner.executor.points) == 1


def test_pause_ramps_to_zero_and_the_point_is_taken_again() -> None:
    runner = Runner()
    runner.until(lambda: runner.demand.plan_point == 1)
    runner.executor.pause()
    runner.until(lambda: runner.executor.state is PlanState.PAUSED)
    for _ in range(20):
        runner.look()
    assert runner.bench.torque_Nm == 0.0
    assert runner.demand.plan_point == -1
    runner.executor.resume()
    runner.finish()
    assert runner.executor.state is PlanState.DONE
    assert [p["index"] for p in runner.executor.points] == [0, 1, 2, 3]


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in plan_kinds() if n != "thermal"])
def test_every_plan_can_be_paused_again_and_again(name: str) -> None:
    config = make_config()
    bench, watcher, demand = FakeBench(config.brake), TickWatcher(), Demand()
    executor = Executor(build(name, config))
    labels = []
    for look in range(1300):
        if look % 307 in (3, 300):
            executor.pause()
        demand = executor.advance(watcher.take(bench.look(demand)))
        if executor.state is PlanState.PAUSED:
            executor.resume()
        labels.append(demand.label)
    assert len(set(labels)) > 1
    assert executor.finished or all(labels)


def test_a_trip_ends_the_plan_and_names_the_cause() -> None:
    runner = Runner()
    runner.until(lambda: runner.demand.plan_point == 0)
    runner.bench.state, runner.bench.trip_bits = State.TRIPPED, int(Trip.OVER_CURRENT)
    runner.finish()
    assert runner.executor.state is PlanState.FAILED
    message = "the bench tripped: OVER_CURRENT (step: 1 Nm, 0.5 Hz: capturing)"
    assert runner.executor.message == message
    assert runner.demand == Demand()


class _SlowlyEnabled(FakeBench):
    """A bench that takes a few looks to be enabled."""

    looks = 0

    def look(self, demand: Demand) -> np.ndarray:
        if demand.enabled and self.state is not State.ENABLED:
            self.looks += 1
            self.state = State.READY if self.looks % 5 else State.ENABLED
        return super().look(demand)


def test_a_plan_may_disable_and_enable_again() -> None:
    def motion(points: tuple[OperatingPoint, ...]) -> Motion[None]:
        for _ in points:
            yield from enable()
            yield from ramp_down()

    points = tuple(OperatingPoint(index, 1.0, 1.0, 1) for index in range(2))
    executor = Executor(Plan("again", points, motion, lambda point: 1.0, {}))
    bench, watcher, demand = _SlowlyEnabled(make_config().brake), TickWatcher(), Demand()
    bench.obeys = False
    for _ in range(100):
        demand = executor.advance(watcher.take(bench.look(demand)))
    assert (executor.state, executor.message) == (PlanState.DONE, "")
    assert bench.looks == 10


def test_a_stop_from_elsewhere_ends_the_plan() -> None:
    runner = Runner()
    runner.until(lambda: runner.demand.plan_point == 0)
    runner.bench.state = State.OFF
    runner.finish()
    assert runner.executor.state is PlanState.ABORTED
    assert not runner.demand.enabled


def test_a_bench_has_the_time_to_be_enabled_that_its_file_may_give_it() -> None:
    runner = Runner()
    runner.bench.obeys = False
    begun_ns = runner.bench.t_ns
    runner.until(lambda: runner.bench.t_ns - begun_ns > 1e9 * ENABLE_MAX_S)
    assert not runner.executor.finished
    runner.bench.state = State.ENABLED
    runner.until(lambda: runner.demand.plan_point == 0)


def test_a_bench_that_does_not_enable_fails_the_plan() -> None:
    runner = Runner()
    runner.bench.obeys = False
    runner.finish()
    assert runner.executor.state is PlanState.FAILED
    assert "not enabled within" in runner.executor.message


@pytest.mark.parametrize(("factor", "hint"), [(0.0, "brake"), (100.0, "rotor")])
def test_a_speed_that_is_not_reached_fails_with_a_hint(factor: float, hint: str) -> None:
    runner = Runner(
        settings={**SMALL, "torques_Nm": [0.2], "settle_timeout_s": 3.0}, brake_factor=factor
    )
    runner.finish()
    assert runner.executor.state is PlanState.FAILED
    assert "0.2 Nm, 0.5 Hz: the speed was still" in runner.executor.message
    assert hint in runner.executor.message
    assert runner.bench.state is State.READY  # ramped down, not left running


def test_a_torque_that_still_ramps_is_why_a_speed_is_not_reached() -> None:
    runner = Runner(settings={**SMALL, "settle_timeout_s": 3.0})
    runner.bench.rate_Nm_per_s = 0.1
    runner.finish()
    assert "the torque still ramps: it needs a longer settle_timeout_s" in runner.executor.message


def test_a_rotor_that_stops_during_capture_fails_the_plan() -> None:
    runner = Runner()
    runner.until(lambda: runner.demand.plan_point == 0)
    runner.bench.brake_factor = 1e9
    runner.finish()
    assert "stopped turning" in runner.executor.message


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"torques_Nm": [9.0]}, "torque_Nm = 6"),
        ({"speeds_Hz": [3.0]}, "trip_speed_rad_s"),
        ({"speeds_Hz": [0.01]}, "brake holds at most"),
        ({"turn": 3}, "setting turn"),
        ({"turns": 1}, "setting turns"),
        ({"compensate": "maybe"}, "one of off, on"),
    ],
)
def test_impossible_settings_are_refused_before_anything_moves(settings, expected: str) -> None:
    with pytest.raises(PlanError, match=expected):
        build("calibrate", make_config(), settings)


def test_unknown_plan_names_those_there_are() -> None:
    with pytest.raises(PlanError, match="calibrate, verify"):
        build("calibrte", make_config())


def test_verify_compensates_and_calibrate_does_not() -> None:
    for name, expected in (("calibrate", 0), ("verify", 7)):
        runner = Runner(name=name)
        runner.until(lambda r=runner: r.demand.plan_point == 0)
        assert runner.demand.compensate == expected


def test_brake_curve_and_its_inverse() -> None:
    from motord.sequencing.brake_servo import brake_torque_Nm, excitation_for

    brake = BrakeConfig(torque_max_Nm=8.0, critical_speed_rad_s=9.0)
    assert brake_torque_Nm(brake, 1.0, 9.0) == pytest.approx(8.0)
    assert brake_torque_Nm(brake, 1.0, 90.0) < 2.0
    assert brake_torque_Nm(brake, 1.0, 0.0) == 0.0
    excitation = excitation_for(brake, 3.0, 4.4)
    assert brake_torque_Nm(brake, excitation, 4.4) == pytest.approx(3.0)
    assert excitation_for(brake, 50.0, 4.4) == 1.0
