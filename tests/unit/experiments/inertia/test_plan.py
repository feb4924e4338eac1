"""The plans for the moment of inertia: what they mark, what they refuse, what they wait for."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from motord.config import OscillationConfig, load, packaged
from motord.experiments.free_rotor import LIGHTER, SLOW_RISE_S, FreeRotor
from motord.experiments.inertia.plan import acceleration
from motord.experiments.plans import build
from motord.rig.truth import load as load_truth
from motord.schema import TICK_DTYPE, State
from motord.sequencing import Executor, OperatingPoint, PlanError, PlanState, TickWatcher
from motord.sequencing.motions import Motion, enable, ramp_down
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan

TICKS_A_LOOK = 20


class Bar:
    """A bar whose angle over time is given; 1,000 ticks a second, always at the same state."""

    def __init__(self, angle_rad: Callable[[float], float], state: State = State.OFF) -> None:
        self.angle_rad, self.state = angle_rad, state
        self.tick = 0

    def look(self, plan_point: int) -> np.ndarray:
        block = np.zeros(TICKS_A_LOOK, TICK_DTYPE)
        for row in block:
            row["tick"], row["t_ns"] = self.tick, 10**18 + self.tick * 1_000_000
            row["angle_rad"] = self.angle_rad(self.tick / 1000) % (2 * np.pi)
            row["state"], row["plan_point"] = self.state, plan_point
            self.tick += 1
        return block


def watch(bar: Bar, seconds: float, **settings: object) -> Executor:
    plan = build("inertia-oscillation", load(packaged("inertia.toml")), settings)
    executor, watcher, point = Executor(plan), TickWatcher(), -1
    while bar.tick < 1000 * seconds and not executor.finished:
        demand = executor.advance(watcher.take(bar.look(point)))
        assert not demand.enabled
        assert demand.torque_Nm == 0
        point = demand.plan_point
    return executor


def released(t_s: float, at_s: float = 2.0, deflection_rad: float = 0.2) -> float:
    """At rest for half a second, pulled until 1 s, held, let go at `at_s`."""
    if t_s < at_s:
        return 1.0 + deflection_rad * float(np.clip(2 * (t_s - 0.5), 0, 1))
    x_s = t_s - at_s
    return 1.0 + deflection_rad * float(np.exp(-2 * x_s) * np.cos(2 * np.pi * 7.5 * x_s))


def test_a_release_is_taken_from_the_hold_to_the_end_of_the_swing() -> None:
    executor = watch(Bar(released), 8.0, repeats=1)
    assert executor.state is PlanState.DONE
    (point,) = executor.points
    assert 1000 < point["tick_start"] < 1500  # held from 1 s on; not the rest before
    assert 3000 < point["tick_end"] <= 3700
    assert point["swing"]["deflection_rad"] == pytest.approx(0.2, rel=0.1)
    assert point["turns"] == 0
    in_time = watch(Bar(released), 8.0, repeats=1, timeout_s=2.5)
    assert (in_time.state, in_time.points) == (PlanState.DONE, executor.points)


def test_a_bar_that_is_pulled_to_and_fro_and_never_let_go_is_waited_for() -> None:
    def pulled(t_s: float) -> float:
        return 0.2 * float(np.clip(2.5 - abs(t_s % 6 - 3), 0, 1))  # up, held, down, held

    bar = Bar(pulled)
    executor = watch(bar, 30.0, repeats=1, timeout_s=20.0)
    assert executor.state is PlanState.FAILED
    assert 20_000 < bar.tick < 20_200
    assert "nothing let go within 20 s: deflect the bar between its springs" in executor.message


def test_too_small_a_deflection_is_reported_and_waited_for() -> None:
    bar = Bar(lambda t_s: released(t_s, deflection_rad=0.06))
    executor = watch(bar, 2.6, deflection_min_rad=0.08)
    assert not executor.points
    assert "(by 0.08 rad at least)" in executor.progress()["step"]


def test_the_bar_may_swing_already_when_the_plan_begins() -> None:
    def later(t_s: float) -> float:
        swinging = 0.1 * float(np.exp(-t_s) * np.cos(47 * t_s)) if t_s < 3 else 0.0
        return 1.0 + swinging if t_s < 3 else released(t_s - 3)

    executor = watch(Bar(later), 8.0, repeats=1)
    assert executor.state is PlanState.DONE
    assert executor.points[0]["tick_start"] > 4000


def test_a_power_stage_that_is_on_is_switched_off() -> None:
    plan = build("inertia-oscillation", load(packaged("inertia.toml")), {"repeats": 1})
    executor, watcher, bar = Executor(plan), TickWatcher(), Bar(released, State.ENABLED)
    asked = []
    while bar.tick < 8000 and not executor.finished:
        demand = executor.advance(watcher.take(bar.look(asked[-1].plan_point if asked else -1)))
        asked.append(demand)
        assert demand.torque_Nm == 0
        if len(asked) > 1 and asked[-2].enabled and not demand.enabled:
            bar.state = State.READY  # as the bench does when `enabled` falls
    assert [demand.enabled for demand in asked[:3]] == [True, False, False]
    assert executor.state is PlanState.DONE
    assert len(executor.points) == 1


def test_a_power_stage_that_stays_on_ends_it_in_time() -> None:
    plan = build("inertia-oscillation", load(packaged("inertia.toml")), {"timeout_s": 1.0})
    executor, watcher, bar = Executor(plan), TickWatcher(), Bar(released, State.ENABLED)
    while bar.tick < 20_000 and not executor.finished:
        demand = executor.advance(watcher.take(bar.look(-1)))
        assert demand.plan_point == -1
    assert executor.state is PlanState.FAILED


def test_after_a_pause_the_release_is_taken_again() -> None:
    plan = build("inertia-oscillation", load(packaged("inertia.toml")), {"repeats": 1})
    executor, watcher, bar, point = Executor(plan), TickWatcher(), Bar(released), -1
    while bar.tick < 2100:
        point = executor.advance(watcher.take(bar.look(point))).plan_point
    assert point == 0
    executor.pause()
    assert executor.advance(watcher.take(bar.look(point))).plan_point == -1
    executor.resume()
    executor.advance(watcher.take(bar.look(-1)))
    assert "hold it still" in executor.progress()["step"]
    assert not executor.points


def test_levers_that_are_not_there_are_refused() -> None:
    with pytest.raises(ValueError, match="spring 1 is at lever 2, levers_m has 1"):
        OscillationConfig(levers_m=(0.5,), springs=({"stiffness_N_per_m": 100, "lever": 2},))
    with pytest.raises(ValueError, match="amplitude_min_rad must be below"):
        OscillationConfig(amplitude_min_rad=0.2)


def test_releases_of_the_simulated_rig() -> None:
    config = load(packaged("inertia.toml"))
    plan = build("inertia-oscillation", config, {"repeats": 3})
    assert len(plan.points) == 3
    assert 10 < plan.seconds < 20
    ticks: list[np.ndarray] = []
    points = run_plan(VirtualBench(config, seed=2), plan, lambda block, _: ticks.append(block))
    block = np.concatenate(ticks)
    assert [point["index"] for point in points] == [0, 1, 2]
    for point in points:
        counts = block["encoder_count"][point["tick_start"] : point["tick_end"] + 1]
        assert np.ptp(counts[:100]) == 0  # held
        assert np.ptp(counts) > 150  # swings both ways
        assert np.ptp(counts[-100:]) < 40
    assert not block["i_cmd_a_A"].any()


def test_steps_of_torque_go_both_ways_from_rest() -> None:
    config = load()
    plan = build("inertia-acceleration", config, {"repeats": 2, "rest_s": 0.6})
    ticks: list[np.ndarray] = []
    points = run_plan(VirtualBench(config, seed=2), plan, lambda block, _: ticks.append(block))
    block = np.concatenate(ticks)
    assert [point["torque_Nm"] for point in points] == [1.0, -1.0]
    for point in points:
        taken = block[point["tick_start"] : point["tick_end"] + 1]
        assert (taken["plan_point"] == point["index"]).all()
        assert np.ptp(taken["encoder_count"][:500].astype(int)) < 20  # at rest
        assert 6.0 < np.abs(taken["speed_rad_s"]).max() < 20.0
        assert np.abs(taken["torque_set_Nm"]).max() == pytest.approx(1.0)
        assert not taken["brake_set"].any()
        assert point["turns"] > 0.5
    assert 5 < plan.seconds < 20


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"torque_Nm": 7.0}, r"7 Nm is above \[limits\] torque_Nm = 6"),
        ({"stop_speed_Hz": 5.0}, "trip_speed_rad_s"),
        ({"compensate": "perhaps"}, "compensate = 'perhaps'"),
        ({"repeats": 0}, "inertia-acceleration: setting repeats"),
    ],
)
def test_steps_beyond_the_limits_are_refused(settings: dict, message: str) -> None:
    with pytest.raises(PlanError, match=message):
        build("inertia-acceleration", load(), settings)


def test_a_rotor_that_does_not_move_is_reported() -> None:
    config = load()
    plan = build(
        "inertia-acceleration", config, {"torque_Nm": 0.05, "timeout_s": 1.5, "rest_s": 0.5}
    )
    executor, watcher = Executor(plan), TickWatcher()
    bar = Bar(lambda _: 1.0, State.ENABLED)
    while bar.tick < 10_000 and not executor.finished:
        executor.advance(watcher.take(bar.look(-1)))
        if executor.state is PlanState.ENDING:
            bar.state = State.READY
    assert executor.state is PlanState.FAILED
    assert "1 Hz not reached; is the rotor free" in executor.message


def test_a_rotor_that_does_not_stop_is_reported() -> None:
    plan = build("inertia-acceleration", load(), {"timeout_s": 1.0, "rest_s": 0.5})
    executor, watcher = Executor(plan), TickWatcher()
    bar = Bar(lambda t_s: 5 * t_s, State.ENABLED)
    while bar.tick < 10_000 and not executor.finished:
        executor.advance(watcher.take(bar.look(-1)))
        if executor.state is PlanState.ENDING:
            bar.state = State.READY
    assert "did not come to rest" in executor.message


class NoisyBar(Bar):
    """A bar whose bridge loses a frame in ten ticks until `until_s`."""

    until_s = 5.0

    def look(self, plan_point: int) -> np.ndarray:
        block = super().look(plan_point)
        block["link_errors"] = np.minimum(block["tick"], 1000 * self.until_s) / 10
        return block


def test_a_release_that_was_noisy_is_waited_for_again() -> None:
    def twice(t_s: float) -> float:
        return released(t_s if t_s < 5.0 else t_s - 5.0)

    executor = watch(NoisyBar(twice), 12.0, repeats=1)
    assert executor.state is PlanState.DONE
    poor, good = executor.points
    assert poor["quality"].startswith("noisy: ")
    assert (poor["take"], good["take"], good["quality"]) == (1, 2, "ok")
    assert executor.points_done == 1


def test_a_band_of_temperature_holds_for_a_release() -> None:
    executor = watch(Bar(released), 8.0, repeats=1, temperature_C=(20.0, 40.0))
    assert executor.points[0]["quality"].startswith("inverter at 0.0 degC, outside")


@pytest.mark.parametrize(
    ("creeps_rad_per_s", "expected"), [(0.001, "ok"), (0.05, "not settled: moved by 0.0")]
)
def test_a_rotor_that_creeps_before_a_step_makes_it_poor(creeps_rad_per_s, expected) -> None:
    plan = build("inertia-acceleration", load(), {"repeats": 1, "rest_s": 0.6})
    executor, watcher = Executor(plan), TickWatcher()
    bar = Bar(lambda t_s: creeps_rad_per_s * t_s, State.ENABLED)
    point = torque_Nm = speed_rad_s = 0
    while not executor.points:
        block = bar.look(point)
        speed_rad_s = speed_rad_s + 1.0 if torque_Nm else 0.0
        block["speed_rad_s"] = speed_rad_s
        demand = executor.advance(watcher.take(block))
        point, torque_Nm = demand.plan_point, demand.torque_Nm
        assert bar.tick < 20_000
    assert executor.points[0]["quality"].startswith(expected)


def test_a_rotor_is_accelerated_as_fast_as_its_inertia_lets_it() -> None:
    limits = load().limits  # 25 rad/s, 10 Nm/s
    heavy, light = FreeRotor(0.05, 0.4), FreeRotor(0.0125, 0.4)
    assert heavy.rise_s(limits, 1.0, 1.0) == light.rise_s(limits, 1.0, 1.0) == 0.0
    rises_s = [light.rise_s(limits, torque_Nm, 1.0) for torque_Nm in (1.0, 1.5, 2.0, 4.0)]
    assert rises_s == sorted(rises_s)
    assert 0.0 < rises_s[1] < rises_s[3] < SLOW_RISE_S
    assert light.rise_s(limits, 4.0, 3.0) == SLOW_RISE_S  # whatever it takes
    assert light.rise_s(limits, -4.0, 1.0) == rises_s[3]  # backwards, too
    assert FreeRotor(0.0, 0.0).rise_s(limits, 1.0, 1.0) == SLOW_RISE_S  # turned by something else


@pytest.mark.parametrize("inertia_kg_m2", [0.006, 0.0105, 0.05])
def test_the_probe_finds_the_inertia_that_is_there(inertia_kg_m2: float) -> None:
    truth = load_truth().model_copy(deep=True)
    rotor = truth.rotor.model_copy(update={"inertia_kg_m2": inertia_kg_m2})
    truth, found = truth.model_copy(update={"rotor": rotor}), []

    def probed(points: tuple[OperatingPoint, ...]) -> Motion[None]:
        own = config.plans.inertia_acceleration
        yield from enable()
        found.append((yield from acceleration.probe_rotor(points[0], own, *bench)))
        yield from ramp_down()

    config = load()
    bench = config.brake, config.limits
    plan = replace(build("inertia-acceleration", config), motion=probed)
    run_plan(VirtualBench(config, truth, seed=1), plan, lambda block, _: None)
    assert 0.9 < found[0].inertia_kg_m2 / inertia_kg_m2 < LIGHTER
    assert 0.1 < found[0].breakaway_Nm < 0.8
