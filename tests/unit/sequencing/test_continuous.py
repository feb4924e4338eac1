"""Operating points without waits between them: what is taken, when it ends, what it is held by."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import inf, pi

import numpy as np
import pytest

from motord.schema import TICK_DTYPE, State, joined
from motord.sequencing import (
    Demand,
    Executor,
    OperatingPoint,
    Plan,
    PlanState,
    TickWatcher,
    continuous,
)
from motord.sequencing.brake_servo import excitation_for
from motord.sequencing.continuous import (
    SETTLE_S,
    Continuous,
    continuous_points,
    lead_s,
    point_s,
)
from motord.sequencing.observation import Precision
from tests.unit.control.bench import make_config
from tests.unit.sequencing.fakes import LOOK_TICKS, PERIOD_NS, FakeBench

pytestmark = pytest.mark.slow

POINTS = tuple(OperatingPoint(n, (3.0, 2.0)[n % 2], (1.0, 0.7)[n % 2], 2) for n in range(6))
POINT_S = 3.0
"""About as long as each takes."""

BRAKE = make_config().brake
SETTINGS = Continuous(
    excitation=excitation_for(BRAKE, 3.0, 2 * pi),
    lead_s=0.4,
    rate_Nm_per_s=10.0,
    durations_s=(POINT_S,) * len(POINTS),
    least_points=2,
)
TARGETS = {"beta_A": 0.1}


@pytest.mark.parametrize("torque_Nm", [0.0008, -3.1, 100_000.3])
def test_a_torque_is_reached_to_single_precision_on_a_small_bench_and_a_large_one(
    torque_Nm: float,
) -> None:
    motion = continuous._point(OperatingPoint(0, torque_Nm, 1.0, 1), SETTINGS)
    next(motion)

    def step(set_Nm: float) -> str:
        tick = np.zeros(1, TICK_DTYPE)
        tick["torque_set_Nm"] = set_Nm
        seen = TickWatcher().take(tick)
        while not isinstance(asked := motion.send(seen), Demand):
            pass
        return asked.label.rpartition(": ")[2]

    steps = [step(part * torque_Nm) for part in (0.0, 0.99, 1.0)]
    assert steps == ["ramping", "ramping", "settling"]


def test_a_ramp_may_take_longer_than_a_torque_that_does_not_come() -> None:
    ride = Ride(replace(SETTINGS, rate_Nm_per_s=0.2), POINTS[:2])
    ride.bench.rate_Nm_per_s = 0.2
    ride.finish()
    assert ride.executor.state is PlanState.DONE, ride.executor.message


class Ride:
    """Points taken on a bench of first order; precision: what the plan knows after n captures."""

    def __init__(
        self,
        settings: Continuous = SETTINGS,
        points: tuple[OperatingPoint, ...] = POINTS,
        precision: Callable[[int], Precision | None] = lambda captures: None,
    ) -> None:
        self.bench, self.watcher = FakeBench(BRAKE), TickWatcher()
        plan = Plan("quick", points, partial(continuous_points, settings), settings.duration_s, {})
        self.executor, self.precision = Executor(plan), precision
        self.demand, self.demands, self.blocks = Demand(), [], []

    def look(self) -> None:
        self.blocks.append(self.bench.look(self.demand))
        seen = self.watcher.take(self.blocks[-1])
        seen = seen._replace(precision=self.precision(len(self.executor.points)))
        self.demand = self.executor.advance(seen)
        self.demands.append(self.demand)

    def until(self, condition: Callable[[], bool]) -> None:
        for _ in range(10_000):
            if condition():
                return
            self.look()
        raise AssertionError(f"not reached: {self.executor.progress()}")

    def finish(self) -> "Ride":
        self.until(lambda: self.executor.finished)
        assert self.bench.state is State.READY or self.executor.state is not PlanState.DONE
        return self

    @property
    def ticks(self) -> np.ndarray:
        return joined(self.blocks)

    @property
    def seconds(self) -> float:
        return len(self.ticks) * PERIOD_NS * 1e-9

    @property
    def taken(self) -> list[int]:
        return [point["index"] for point in self.executor.points]


@pytest.mark.parametrize("ramp_time_constants", [0.0, 0.3, 1.0, 2.0, 5.0, 50.0])
def test_the_first_torque_is_at_most_a_third_ahead_of_the_brake(ramp_time_constants: float) -> None:
    time_constant_s = BRAKE.excitation_time_constant_s
    ramp_s = ramp_time_constants * time_constant_s
    passed_s = np.linspace(0.0, 3 * time_constant_s + ramp_s, 1000)
    torque = np.minimum(passed_s / ramp_s, 1.0) if ramp_s else np.ones_like(passed_s)
    since_s = lead_s(BRAKE, ramp_s) + passed_s
    brake = (1 - np.exp(-since_s / time_constant_s)) ** 2  # goes with the excitation's square
    assert 1.0 <= (torque / brake).max() < 1.34


def test_the_brake_is_not_led_by_more_than_a_step_of_torque_needs() -> None:
    assert lead_s(BRAKE) == pytest.approx(2 * BRAKE.excitation_time_constant_s)
    assert lead_s(BRAKE, 100.0) == pytest.approx(BRAKE.excitation_time_constant_s)


def test_every_point_is_taken_from_where_the_rotor_is() -> None:
    ride = Ride().finish()
    assert ride.executor.state is PlanState.DONE
    assert ride.executor.message == ""
    assert ride.taken == list(range(len(POINTS)))
    for point in ride.executor.points:
        assert point["turns_from_start"]
        assert point["quality"] == "ok"
        assert 2.0 <= point["turns"] < 2.1
    assert ride.bench.torque_Nm == 0.0


def test_the_excitation_stays_as_it_is_until_the_end() -> None:
    ride = Ride().finish()
    loaded = [one for one in ride.demands if one.torque_Nm]
    first = ride.demands.index(loaded[0])
    assert {one.brake for one in ride.demands[first:-1]} == {SETTINGS.excitation}
    assert ride.demands[-1] == Demand()


def test_a_capture_begins_when_the_ramp_is_over_and_speed_has_had_time_to_follow() -> None:
    ride = Ride().finish()
    settle = round(SETTLE_S / (PERIOD_NS * 1e-9))
    for point in ride.executor.points:
        wanted_Nm = POINTS[point["index"]].torque_Nm
        first = int(np.argmax(ride.ticks["tick"] == point["tick_start"]))
        before = ride.ticks["torque_set_Nm"][first - settle + LOOK_TICKS : first + 1]
        assert before == pytest.approx(wanted_Nm, abs=1e-3)


def test_a_torque_that_is_not_reached_fails_and_names_it() -> None:
    ride = Ride()
    ride.until(lambda: ride.bench.torque_Nm > 0)
    set_torque = ride.bench.look

    def stuck(demand: Demand) -> np.ndarray:
        block = set_torque(demand)
        ride.bench.torque_Nm = min(ride.bench.torque_Nm, 1.5)
        block["torque_set_Nm"] = np.minimum(block["torque_set_Nm"], 1.5)
        return block

    ride.bench.look = stuck
    ride.finish()
    assert ride.executor.state is PlanState.FAILED
    assert ride.executor.message.startswith("3 Nm, about 1 Hz: the torque is still 1.5 Nm")
    assert ride.taken == []


def test_it_ends_as_soon_as_the_targets_are_reached_even_in_mid_capture() -> None:
    settings = replace(SETTINGS, targets=TARGETS)
    ride = Ride(settings)
    ride.until(lambda: len(ride.taken) == 2)
    ride.until(lambda: ride.demand.plan_point == 2)
    for _ in range(20):
        ride.look()
    assert ride.demand.plan_point == 2
    ride.precision = lambda captures: Precision(2, {"beta_A": 0.05})
    ride.look()
    assert ride.demand.torque_Nm == 0.0
    assert ride.demand.plan_point == -1
    ride.finish()
    assert ride.executor.state is PlanState.DONE
    assert ride.executor.message == "targets reached: beta_A 0.05 of 0.1"
    assert ride.taken == [0, 1]


@pytest.mark.parametrize(
    "precision",
    [
        None,
        Precision(3, {"beta_A": 0.11}),
        Precision(3, {"alpha_percent": 0.01}),
        Precision(3, {"beta_A": 0.05}, obstacle="findings: back-emf"),
    ],
)
def test_it_goes_on_while_a_target_is_not_reached(precision: Precision | None) -> None:
    ride = Ride(replace(SETTINGS, targets=TARGETS), POINTS[:3], lambda captures: precision)
    assert ride.finish().taken == [0, 1, 2]
    assert ride.executor.message == ""


@pytest.mark.parametrize("short", [1.0, 0.6])
def test_points_are_skipped_that_do_not_fit_into_the_time(short: float) -> None:
    durations_s = (short * POINT_S,) * len(POINTS)
    settings = replace(SETTINGS, durations_s=durations_s, limit_s=11.0)
    ride = Ride(settings).finish()
    taken = len(ride.taken)
    assert 2 < taken < len(POINTS)
    assert ride.taken == list(range(taken))
    assert ride.executor.state is PlanState.DONE
    assert ride.executor.message == f"time limit of 11 s: {taken} of 6 points taken"
    assert ride.seconds <= 11.0


@pytest.mark.parametrize(("more_s", "taken"), [(0.3, 2), (0.8, 3)])
def test_the_ramp_down_belongs_to_the_time(more_s: float, taken: int) -> None:
    whole = Ride().finish()
    began_ns = int(whole.ticks["t_ns"][0])
    ends_s = np.array([(one["t_end_ns"] - began_ns) * 1e-9 for one in whole.executor.points])
    durations_s = tuple(np.diff(ends_s, prepend=0.0))
    limit_s = ends_s[2] + more_s  # from 3 Nm it takes 0.3 s to 0, then END_S
    ride = Ride(replace(SETTINGS, durations_s=durations_s, limit_s=limit_s)).finish()
    assert ride.taken == list(range(taken))
    assert ride.seconds <= limit_s


@pytest.mark.parametrize("least", [1, 2, 4])
def test_the_first_points_are_taken_whatever_the_time(least: int) -> None:
    ride = Ride(replace(SETTINGS, least_points=least, limit_s=0.5)).finish()
    assert ride.taken == list(range(least))
    assert ride.executor.message.startswith("time limit of 0.5 s")


@pytest.mark.parametrize(("limit_s", "lasts_s"), [(inf, 16.1), (15.5, 15.5), (10.0, 13.4)])
def test_a_brake_that_is_too_strong_is_lowered_where_the_time_is_short(
    limit_s: float, lasts_s: float
) -> None:
    own_s = tuple(point_s(point) + 0.3 for point in POINTS[:4])
    settings = replace(SETTINGS, least_points=4, limit_s=limit_s, durations_s=own_s)
    ride = Ride(settings, POINTS[:4])
    ride.bench.brake_factor = 1.3
    ride.finish()
    excitations = {demand.brake for demand in ride.demands if demand.enabled}
    assert (len(excitations) == 1) is (limit_s == inf)
    assert min(excitations) >= SETTINGS.excitation / 1.3**0.5
    assert ride.bench.fastest_rad_s <= 2 * pi
    assert ride.taken == [0, 1, 2, 3]
    assert lasts_s - 0.2 <= ride.seconds <= lasts_s


@pytest.mark.parametrize("planned_ramp_s", [0.0, 8.0])
@pytest.mark.parametrize("paused", range(4))
def test_a_pause_is_not_taken_for_a_brake_that_is_too_strong(
    paused: int, planned_ramp_s: float
) -> None:
    points = tuple(OperatingPoint(n, 3.0, 1.0, 2) for n in range(4))
    ramps_s = (6.0, *(planned_ramp_s,) * 3)  # after a pause it is 6 s, whatever was planned
    own_s = tuple(point_s(one) + ramp_s for one, ramp_s in zip(points, ramps_s, strict=True))
    settings = replace(SETTINGS, least_points=4, limit_s=8.0, durations_s=own_s, rate_Nm_per_s=0.5)
    ride = Ride(settings, points)
    ride.bench.rate_Nm_per_s = 0.5
    ride.until(lambda: ride.demand.plan_point == paused)
    ride.executor.pause()
    ride.until(lambda: ride.executor.state is PlanState.PAUSED)
    ride.executor.resume()
    assert ride.finish().taken == [0, 1, 2, 3]
    loaded = {demand.brake for demand in ride.demands if demand.torque_Nm}
    assert loaded == {SETTINGS.excitation}
    assert ride.bench.fastest_rad_s <= 2 * pi


def test_the_rest_of_a_plan_beyond_its_least_points_has_the_whole_excitation() -> None:
    own_s = tuple(point_s(point) + 0.3 for point in POINTS)
    settings = replace(SETTINGS, least_points=1, limit_s=sum(own_s[:5]), durations_s=own_s)
    ride = Ride(settings, POINTS[2:])
    ride.bench.brake_factor = 1.3
    assert ride.finish().taken == [2, 3]
    assert {one.brake for one in ride.demands if one.torque_Nm} == {SETTINGS.excitation}


def test_a_pause_in_mid_capture_takes_the_point_again() -> None:
    ride = Ride(replace(SETTINGS, limit_s=inf), POINTS[:3])
    ride.until(lambda: ride.demand.plan_point == 1)
    for _ in range(20):
        ride.look()
    ride.executor.pause()
    ride.until(lambda: ride.executor.state is PlanState.PAUSED)
    assert ride.demand.plan_point == -1
    paused_tick = int(ride.ticks["tick"][-1])
    ride.executor.resume()
    ride.finish()
    assert ride.executor.state is PlanState.DONE
    assert ride.taken == [0, 1, 2]
    again = ride.executor.points[1]
    assert again["tick_start"] > paused_tick
    assert again["turns"] >= 2.0
    first = int(np.argmax(ride.ticks["tick"] == again["tick_start"]))
    assert ride.ticks["torque_set_Nm"][first] == pytest.approx(2.0, abs=1e-3)


def test_an_abort_ramps_down_and_disables() -> None:
    ride = Ride()
    ride.until(lambda: ride.demand.plan_point == 1)
    ride.executor.abort()
    ride.finish()
    assert ride.executor.state is PlanState.ABORTED
    assert ride.taken == [0]
    assert ride.bench.state is State.READY


def test_a_poor_point_is_taken_again() -> None:
    ride = Ride(replace(SETTINGS, band_C=(20.0, 30.0)), POINTS[:1])
    look = ride.bench.look

    def warm(demand: Demand) -> np.ndarray:
        block = look(demand)
        block["temperature_C"] = 25.0 if ride.executor.points else 35.0
        return block

    ride.bench.look = warm
    ride.finish()
    assert [(one["take"], one["quality"] == "ok") for one in ride.executor.points] == [
        (1, False), (2, True),
    ]  # fmt: skip


def poor(ride: Ride) -> Ride:
    """Let every capture be of poor quality."""
    look = ride.bench.look

    def hot(demand: Demand) -> np.ndarray:
        block = look(demand)
        block["temperature_C"] = 35.0
        return block

    ride.bench.look = hot
    return ride


def test_a_pause_in_a_second_take_is_no_further_take() -> None:
    ride = poor(Ride(replace(SETTINGS, band_C=(20.0, 30.0)), POINTS[:1]))
    ride.until(lambda: len(ride.taken) == 1 and ride.demand.plan_point == 0)
    ride.executor.pause()
    ride.until(lambda: ride.executor.state is PlanState.PAUSED)
    ride.executor.resume()
    ride.finish()
    assert [one["take"] for one in ride.executor.points] == [1, 2, 3]


def test_every_take_of_a_poor_point_counts_in_the_time() -> None:
    settings = replace(SETTINGS, band_C=(20.0, 30.0), least_points=1, limit_s=19.2)
    ride = poor(Ride(settings)).finish()
    assert ride.taken == [0, 0, 0, 1, 1, 1]
    assert ride.executor.message == "time limit of 19.2 s: 2 of 6 points taken"
    assert ride.seconds <= 19.2


def test_a_pause_takes_no_time() -> None:
    settings = replace(SETTINGS, limit_s=11.0)
    whole = Ride(settings).finish()
    ride = Ride(settings)
    ride.until(lambda: ride.demand.plan_point == 1)
    ride.executor.pause()
    ride.until(lambda: ride.executor.state is PlanState.PAUSED)
    for _ in range(3000):  # a minute
        ride.look()
    ride.executor.resume()
    assert ride.finish().taken == whole.taken


def test_what_a_pause_cut_short_took_time() -> None:
    settings = replace(SETTINGS, limit_s=11.0)
    ride, pauses = Ride(settings), 0
    while pauses < 3:
        ride.until(lambda: ride.demand.plan_point == 0)
        for _ in range(90):  # 1.8 s of 2.9
            ride.look()
        ride.executor.pause()
        ride.until(lambda: ride.executor.state is PlanState.PAUSED)
        ride.executor.resume()
        pauses += 1
    ride.finish()
    assert ride.taken == [0, 1]


def test_the_rest_of_a_plan_has_what_was_left_of_the_time() -> None:
    settings = replace(SETTINGS, limit_s=11.0)
    whole = Ride(settings).finish()
    assert whole.taken == [0, 1, 2]
    rest = Ride(settings, POINTS[2:]).finish()
    assert rest.taken == [2]
    assert rest.executor.message == whole.executor.message
    assert Ride(settings, POINTS[3:]).finish().taken == []
