"""A plan that is repeated: its points, the rest between, its end; on a bench of first order."""

import pickle
from itertools import pairwise
from typing import Any

import pytest

from motord.experiments.plans import build
from motord.schema import State, Trip
from motord.sequencing import PlanError, PlanState
from tests.unit.control.bench import make_config
from tests.unit.sequencing.test_executor import Runner

INNER = {"torques_Nm": [1.0], "speeds_Hz": [0.5, 1.0], "turns": 4, "settle_s": 0.5}
SOAK = {"plan": "verify", "inner": INNER, "repeats": 3, "pause_s": 5.0}


def soak(**changes: Any) -> Runner:
    return Runner({**SOAK, **changes}, name="soak")


def rests_s(runner: Runner) -> list[float]:
    """Return how long the bench was switched off between captures."""
    times, since = [], None
    while not runner.executor.finished:
        runner.look()
        off = runner.bench.state is State.READY
        if off and since is None and not runner.executor.over:
            since = runner.bench.t_ns
        elif not off and since is not None:
            times.append((runner.bench.t_ns - since) * 1e-9)
            since = None
    return times


def test_every_repetition_takes_the_inner_points_with_numbers_of_their_own():
    runner = soak()
    runner.finish()
    assert runner.executor.state is PlanState.DONE
    points = runner.executor.points
    assert [(p["index"], p["repetition"], p["inner_index"]) for p in points] == [
        (0, 1, 0), (1, 1, 1), (2, 2, 0), (3, 2, 1), (4, 3, 0), (5, 3, 1),
    ]  # fmt: skip
    assert [p["speed_Hz"] for p in points] == [0.5, 1.0] * 3
    assert {p["quality"] for p in points} == {"ok"}
    for point in points:
        ticks = runner.marked[point["index"]]
        assert (ticks[0], ticks[-1]) == (point["tick_start"], point["tick_end"])
    progress = runner.executor.progress()
    assert (progress["points"], progress["points_done"], progress["eta_s"]) == (6, 6, 0.0)


def test_between_repetitions_the_bench_is_off_for_the_pause():
    assert rests_s(soak()) == [pytest.approx(5.0, abs=0.1)] * 2


def test_the_time_left_counts_repetitions_and_rests():
    runner = soak()
    whole_s = runner.executor.plan.seconds
    inner_s = build("verify", runner.config, INNER).seconds
    assert whole_s == pytest.approx(3 * inner_s + 2 * 5.0)
    left_s = []
    while not runner.executor.finished:
        runner.look()
        left_s.append(runner.executor.progress()["eta_s"])
    assert left_s[0] == pytest.approx(whole_s, abs=0.2)
    assert all(after <= before for before, after in pairwise(left_s))


def test_hours_say_how_many_begin_and_when_no_further_one_does():
    config, inner_s = make_config(), build("verify", make_config(), INNER).seconds
    hours = (4 * inner_s + 3 * 5.0 + 1.0) / 3600
    plan = build("soak", config, {**SOAK, "repeats": 0, "hours": hours})
    assert len(plan.points) == 4 * 2
    assert "4 repetitions of verify, 2 points and about" in plan.outlook
    assert plan.outlook.endswith("GB")
    slow = soak(repeats=0, hours=hours)
    slow.until(lambda: "rest before repetition 2" in slow.demand.label)
    slow.bench.t_ns += round(hours * 3.6e12)  # it took longer than was estimated
    slow.finish()
    assert slow.executor.state is PlanState.DONE
    assert slow.executor.points_done == 2
    assert "hours are over, after 1 repetitions" in slow.executor.message


def test_a_pause_in_a_point_and_one_in_a_rest_cost_no_point():
    runner = soak()
    runner.until(lambda: runner.demand.plan_point == 2)
    for reached in (
        lambda: runner.demand.plan_point == 3,
        lambda: "rest before repetition 3" in runner.demand.label,
        lambda: runner.demand.plan_point == 4,
    ):
        runner.executor.pause()
        runner.until(lambda: runner.executor.state is PlanState.PAUSED)
        runner.executor.resume()
        runner.until(reached)
    runner.finish()
    assert [p["index"] for p in runner.executor.points] == list(range(6))


def test_what_is_missing_is_taken_from_the_middle_of_a_repetition_on():
    runner = soak()
    plan = runner.executor.plan
    runner.executor = type(runner.executor)(plan.part(plan.points[3:]))
    assert rests_s(runner) == [pytest.approx(5.0, abs=0.1)]
    assert [p["index"] for p in runner.executor.points] == [3, 4, 5]


def test_a_trip_in_a_repetition_ends_the_soak():
    runner = soak()
    runner.until(lambda: runner.demand.plan_point == 2)
    runner.bench.state, runner.bench.trip_bits = State.TRIPPED, Trip.OVER_SPEED
    runner.look()
    assert runner.executor.state is PlanState.FAILED
    assert "OVER_SPEED" in runner.executor.message
    assert [p["repetition"] for p in runner.executor.points] == [1, 1]
    assert not runner.demand.enabled


def test_what_fails_says_in_which_repetition():
    runner = soak()
    runner.until(lambda: runner.demand.plan_point == 2)
    runner.bench.brake_factor = 100.0
    runner.finish()
    assert runner.executor.state is PlanState.FAILED
    assert runner.executor.message.startswith("repetition 2: ")


def test_the_rest_waits_for_the_inverter_to_cool_down_and_not_for_ever(monkeypatch):
    for cools, state in ((True, PlanState.DONE), (False, PlanState.FAILED)):
        runner = soak(cool_below_C=40.0, cool_timeout_s=6.0)
        look, runner.resting = runner.bench.look, 0

        def warm(demand, look=look, runner=runner, cools=cools):
            block = look(demand)
            runner.resting += "cooling" in demand.label
            block["temperature_C"] = 30.0 if cools and runner.resting % 100 == 99 else 50.0
            return block

        monkeypatch.setattr(runner.bench, "look", warm)
        runner.finish()
        assert runner.executor.state is state, runner.executor.message
        assert cools or "the inverter is at 50 degC after 6 s" in runner.executor.message
        assert not cools or runner.resting == 199


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"plan": "soak"}, "soak: setting plan: a soak does not repeat a soak"),
        ({"plan": "nothing"}, "soak: inner plan nothing: no plan 'nothing'; there are: "),
        ({"inner": {"turns": -1}}, "soak: inner plan verify: verify: setting turns: "),
        ({"inner": {"torques_Nm": [99.0]}}, "soak: inner plan verify: .*99 Nm"),
        ({"inner": {"compensate": "x"}}, "soak: inner plan verify: compensate = 'x': one of"),
        ({"inner": 3}, "soak: setting inner: "),
        ({"repeats": -1}, "soak: setting repeats: "),
        ({"repeats": 0, "hours": 0.0}, "soak: set repeats or hours"),
        ({"repeats": 10**6}, "more than 3000 points; set repeats"),
        ({"repeats": 0, "hours": 8760.0}, "more than 3000 points; set repeats"),
        ({"repeats": 0, "hours": 1e308}, "soak: setting hours: "),
        ({"pause_s": 1e308}, "soak: setting pause_s: "),
        ({"cool_timeout_s": 1e308}, "soak: setting cool_timeout_s: "),
        ({"plan": "calibrate", "inner": {"time_limit_s": 300.0, "beta_A": 0.05}},
         "soak: inner plan calibrate: it ends early by what it finds"),
    ],
)  # fmt: skip
def test_what_cannot_be_repeated_is_refused(settings, message):
    with pytest.raises(PlanError, match=message):
        build("soak", make_config(), {**SOAK, **settings})


def test_the_same_plan_comes_of_its_own_settings_and_crosses_processes():
    plan = build("soak", make_config(), {**SOAK, "compensate": "off"})
    assert (plan.settings["compensate"], plan.settings["inner"]["compensate"]) == ("off", "off")
    again = build("soak", make_config(), plan.settings)
    assert (again.points, again.settings) == (plan.points, plan.settings)
    assert pickle.loads(pickle.dumps(plan)).points == plan.points


def test_one_value_for_a_list_of_the_inner_plan_is_a_list_of_one():
    inner = {"torques_Nm": 1.0, "speeds_Hz": [0.5], "turns": 4}
    plan = build("soak", make_config(), {**SOAK, "inner": inner})
    assert plan.settings["inner"]["torques_Nm"] == [1.0]
    assert len(plan.points) == 3
