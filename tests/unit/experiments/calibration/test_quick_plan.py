"""`calibrate` with a time limit or targets: which points it takes, what it promises and refuses."""

from functools import cache
from itertools import pairwise
from math import pi

import numpy as np
import pytest

from motord.config import Config, load
from motord.experiments.calibration.design import Design
from motord.experiments.calibration.visits import LEAST_VISITS, TURNS, Objective, visits
from motord.experiments.plans import build
from motord.sequencing import NOTHING_INDUCED, Demand, Executor, Plan, PlanError, TickWatcher
from motord.sequencing.brake_servo import brake_torque_Nm
from motord.sequencing.limits import SPEED_MARGIN
from tests.unit.experiments.calibration.test_any_motor import MOTORS, bench
from tests.unit.sequencing.fakes import FakeBench

TARGETS = {"alpha_percent": 0.1, "beta_A": 0.03, "cogging_percent": 1.5}
BRAKE = load().brake
FINEST = {"alpha_percent": 0.05, "beta_A": 0.01, "cogging_percent": 0.5, "ripple_percent": 0.05}


@pytest.fixture(scope="module")
def config() -> Config:
    return load()


@cache
def quick(limit_s: float, directions: str = "both", **targets: float) -> Plan:
    settings = {"time_limit_s": limit_s, "directions": directions, **targets}
    return build("calibrate", load(), settings)


def turns(plan: Plan) -> int:
    return sum(point.turns for point in plan.points)


@pytest.mark.parametrize(
    ("limit_s", "directions", "targets"),
    [
        (10, "both", {}),
        (10, "forwards", {}),
        (30, "both", {}),
        (30, "forwards", {}),
        (30, "both", TARGETS),
    ],
)
def test_the_points_fit_into_the_time_and_are_enough_for_errors(
    limit_s: float, directions: str, targets: dict[str, float]
) -> None:
    plan = quick(limit_s, directions, **targets)
    assert 0.7 * limit_s < sum(map(plan.point_s, plan.points)) <= limit_s
    assert plan.seconds <= limit_s + 0.5  # the first ramp is counted with the first point as well
    assert len(plan.points) >= 4
    assert turns(plan) >= LEAST_VISITS * TURNS
    assert [point.index for point in plan.points] == list(range(len(plan.points)))
    assert plan.continuous
    assert plan.targets == targets
    assert bool(plan.estimator) == bool(targets)


@pytest.mark.parametrize("limit_s", [10, 30])
def test_forwards_never_turns_back_and_both_does(limit_s: float) -> None:
    forwards, both = quick(limit_s, "forwards"), quick(limit_s)
    assert all(point.torque_Nm > 0 < point.speed_Hz for point in forwards.points)
    assert {point.torque_Nm > 0 for point in both.points} == {True, False}
    assert all(point.torque_Nm * point.speed_Hz > 0 for point in both.points)


@pytest.mark.parametrize("limit_s", [10, 30])
def test_torques_and_speeds_keep_their_distance_from_the_limits(
    config: Config, limit_s: float
) -> None:
    plan = quick(limit_s)
    assert max(abs(point.torque_Nm) for point in plan.points) == 5.0
    fastest_rad_s = max(2 * pi * abs(point.speed_Hz) for point in plan.points)
    assert fastest_rad_s <= SPEED_MARGIN * config.limits.trip_speed_rad_s
    ticks_per_cycle = 2 * pi * config.loop.rate_Hz / fastest_rad_s / config.motor.pole_pairs
    assert ticks_per_cycle >= 79.9


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"time_limit_s": 5}, r"time_limit_s = 5 is too short: 8 turns at .* take 5\.1 s"),
        ({"time_limit_s": 4}, "time_limit_s: Input should be greater than or equal to 5"),
        ({"beta_A": 0.0001}, r"beta_A = 0\.0001 cannot be reached in 120 s: about 0\.\d+ is to be"),
        ({"beta_A": 0.0001, "time_limit_s": 30}, r"beta_A = 0\.0001 cannot be reached in 30 s"),
        ({"torques_Nm": [6.5], "time_limit_s": 30}, r"6\.5 Nm is above \[limits\] torque_Nm = 6"),
        ({"beta_A": 0.0}, "beta_A: Input should be greater than or equal to 0.000001"),
        ({"ripple_percent": 1e-300}, "ripple_percent: Input should be greater than or equal to"),
        ({"ripple_percent": 1e-6}, r"cannot be reached in 120 s: about 0\.0\d+ is to be"),
    ],
)
def test_what_cannot_be_done_is_refused_with_what_stands_in_the_way(
    config: Config, settings: dict[str, object], expected: str
) -> None:
    with pytest.raises(PlanError, match=expected):
        build("calibrate", config, settings)


def test_a_brake_that_is_too_weak_is_refused_with_what_it_holds(config: Config) -> None:
    brake = config.brake.model_copy(update={"torque_max_Nm": 4.0})
    weak = config.model_copy(update={"brake": brake})
    with pytest.raises(PlanError, match=r"the brake holds at most .* torques_Nm has 5"):
        build("calibrate", weak, {"time_limit_s": 30})


def test_the_dry_run_says_what_to_expect(config: Config) -> None:
    limited = quick(30)
    assert limited.outlook.startswith("to be expected after 27 s: ripple_percent 0.0")
    reached = quick(30, ripple_percent=0.2)
    assert reached.outlook.startswith("the targets should be reached after about ")
    assert 5 < float(reached.outlook.split()[-2]) < 30
    short = quick(10, alpha_percent=0.5)
    assert short.outlook.startswith("to be expected after ")
    assert "alpha_percent 1." in short.outlook
    assert "ripple" not in short.outlook
    assert build("calibrate", config).outlook == ""


@pytest.mark.parametrize("targets", [{}, TARGETS], ids=["limit", "targets"])
def test_the_same_settings_give_the_same_points(targets: dict[str, float]) -> None:
    one = quick(30, **targets)
    again = build("calibrate", load(), one.settings)  # as a plan that is resumed
    assert again.points == one.points
    assert again.settings == one.settings
    assert again.seconds == one.seconds


@pytest.mark.parametrize("directions", [(1,), (1, -1)], ids=["forwards", "both"])
def test_more_points_never_make_the_expected_half_widths_larger(
    config: Config, directions: tuple[int, ...]
) -> None:
    design = Design(config, 5.0, directions)
    objective = Objective.of(design, FINEST, (1.0, 3.0, 5.0))
    chosen = visits(design, objective, 1.0, 10.0, 40.0)
    assert len(chosen) > 5
    assert chosen[0].half_widths.keys() == FINEST.keys()
    before = objective.half_widths(np.linalg.inv(design.prior))
    assert all(before[name] > chosen[0].half_widths[name] for name in FINEST)
    for first, second in pairwise(chosen):
        for name, half in second.half_widths.items():
            assert half <= first.half_widths[name] * (1 + 1e-9)


def test_more_time_never_expects_less(config: Config) -> None:
    design = Design(config, 5.0, (1, -1))
    objective = Objective.of(design, {}, (1.0, 5.0))
    ends = [visits(design, objective, 1.0, 10.0, limit_s)[-1] for limit_s in (15.0, 30.0)]
    ripple = [one.half_widths["ripple_percent"] for one in ends]
    assert ripple == sorted(ripple, reverse=True)


def test_without_time_limit_and_targets_it_is_the_mesh(config: Config) -> None:
    mesh = build("calibrate", config)
    assert len(mesh.points) == 32
    assert not mesh.continuous
    assert not mesh.estimator
    assert not mesh.targets
    assert {point.turns for point in mesh.points} == {24}
    compensated = build("calibrate", config, {"compensate": "off"})
    assert compensated.points == mesh.points


@pytest.mark.parametrize("motor", [MOTORS[0], MOTORS[2]], ids=str)
def test_any_motor_has_a_quick_plan(motor: object) -> None:
    other, _ = bench(motor)
    plan = build("calibrate", other, {"time_limit_s": 30})
    assert len(plan.points) >= 4
    assert turns(plan) >= LEAST_VISITS * TURNS
    assert "ripple_percent" in plan.outlook
    assert {point.induced.gain for point in plan.points if point.induced != NOTHING_INDUCED} <= {
        (0.5, 1.0, 1.0), (1.0, 0.5, 1.0), (1.0, 1.0, 0.5),
    }  # fmt: skip


def loaded(plan: Plan) -> Demand:
    """Return the first demand with torque."""
    fake, watcher, demand = FakeBench(BRAKE), TickWatcher(), Demand()
    executor = Executor(plan)
    for _ in range(40):
        demand = executor.advance(watcher.take(fake.look(demand)))
        if demand.torque_Nm:
            return demand
    raise AssertionError(f"no torque: {executor.progress()}")


def test_a_part_of_it_keeps_excitation_numbers_and_durations(config: Config) -> None:
    plan = build("calibrate", config, {"time_limit_s": 30, "torques_Nm": [1.0, 4.0]})
    lowest = min(plan.points, key=lambda point: abs(point.torque_Nm))
    part = plan.part((lowest,))
    assert 0 < loaded(plan).brake < 1
    assert loaded(part).brake == loaded(plan).brake
    assert loaded(part).torque_Nm == lowest.torque_Nm
    assert part.points == (lowest,)
    assert part.point_s(lowest) == plan.point_s(lowest)
    held_Nm = brake_torque_Nm(config.brake, loaded(plan).brake, 2 * pi * plan.points[0].speed_Hz)
    assert held_Nm == pytest.approx(plan.points[0].torque_Nm, rel=1e-3)
