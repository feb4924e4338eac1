"""When heat-up and cooling end, and what is refused or ends the plan; looks are made up."""

from collections.abc import Callable
from dataclasses import replace
from math import exp

import numpy as np
import pytest

from motord.config import Config, load, packaged
from motord.experiments.plans import build
from motord.experiments.thermal.steadiness import READINGS_KEPT, ChannelWindow, slope_of
from motord.schema import State
from motord.sequencing import Demand, Executor, Observation, PlanError
from motord.sequencing.executor import PlanState
from motord.sequencing.observation import ChannelValue

BENCH = packaged("../../../config/thermal.toml")
LOOK_S = 0.5
SMALL = {"magnet_channel": "", "housing_channel": "", "steady_window_s": 30.0}


@pytest.fixture(scope="module")
def config() -> Config:
    return load(BENCH)


def with_channel(config: Config, **changes: object) -> Config:
    first, *others = config.channels
    return config.model_copy(update={"channels": (first.model_copy(update=changes), *others)})


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"winding_channel": "none_C"}, 'winding_channel = "none_C": the bench file has no such'),
        ({"ambient_channel": "room_C"}, 'ambient_channel = "room_C": the bench file has no such'),
        ({"winding_channel": ""}, "without winding_channel"),
        ({"winding_channel": "", "magnet_channel": "", "housing_channel": ""}, "name a channel"),
        ({"ambient_channel": "winding_C"}, "a channel is named twice"),
        ({"temperature_max_C": 130.0}, 'not below trip_above = 130 of [[channels]] "winding_C"'),
        ({"heating_max_s": 604_801.0}, "heating_max_s"),
        ({"cooling_max_s": 1e12}, "cooling_max_s"),
        ({"steady_window_s": 600.0}, "shorter than heating_max_s"),
        ({"torque_Nm": 6.5}, "above [limits] torque_Nm"),
        ({"speed_Hz": 0.5}, "the brake holds at most"),
        ({"compensate": "on"}, "always 'off'"),
    ],
)
def test_what_is_refused_names_its_setting(
    config: Config, settings: dict[str, object], why: str
) -> None:
    with pytest.raises(PlanError) as error:
        build("thermal", config, settings)
    assert why in str(error.value)


def test_more_current_than_may_flow_for_long_is_refused(config: Config) -> None:
    limits = config.limits.model_copy(update={"i2t_current_A": 15.0})
    with pytest.raises(
        PlanError, match=r"16.2 A is more than may flow for long.*i2t_current_A = 15; lower"
    ):
        build("thermal", config.model_copy(update={"limits": limits}))


@pytest.mark.parametrize("unit", ["bar", "C", "degc"])
def test_a_channel_that_is_not_in_degC_is_refused(config: Config, unit: str) -> None:
    with pytest.raises(PlanError, match=f'says that it is in "{unit}"; .* unit = "degC"'):
        build("thermal", with_channel(config, unit=unit))


def test_a_bench_without_channels_is_refused() -> None:
    with pytest.raises(PlanError, match=r"no such entry of \[\[channels\]\]; it has none"):
        build("thermal", load())


def test_the_current_may_be_given_instead_of_the_torque(config: Config) -> None:
    plan = build("thermal", config, {"current_A": 8.0})
    amplitude_A = plan.points[0].torque_Nm * 2 / 3 / 0.206
    assert amplitude_A == pytest.approx(8.0 * np.sqrt(2), rel=1e-3)


def test_the_dry_run_says_what_it_costs(config: Config) -> None:
    plan = build("thermal", config)
    assert plan.seconds == pytest.approx(1200, abs=30)
    assert "11.4 A RMS a phase, 39.3 W of heat" in plan.outlook
    assert "0.33 h at most" in plan.outlook
    assert "GB before compression" in plan.outlook
    unknown = build("thermal", config, {"resistance_ohm": 0.0})
    assert "time constants only" in unknown.outlook


def test_it_is_made_again_from_its_own_settings(config: Config) -> None:
    plan = build("thermal", config)
    again = build("thermal", config, plan.settings)
    assert (again.points_digest, again.settings) == (plan.points_digest, plan.settings)


class Bench:
    """A motor of one time constant that does what is demanded at once, and is looked at."""

    def __init__(self, config: Config, **settings: object) -> None:
        self.executor = Executor(build("thermal", config, {**SMALL, **settings}))
        self.t_s, self.winding_C, self.demand = 0.0, 25.0, Demand()
        self.read: Callable[[float], ChannelValue] = lambda value: ChannelValue(self.t_s, value)
        self.seen: list[Demand] = []
        self.speed_Hz: float | None = None

    def look(self) -> None:
        self.t_s += LOOK_S
        steady_C = 25.0 + (60.0 if self.demand.torque_Nm else 0.0)
        self.winding_C = steady_C + (self.winding_C - steady_C) * exp(-LOOK_S / 40.0)
        enabled, speed_Hz = self.demand.enabled, self.demand.speed_Hz
        observed = Observation(
            t_ns=round(self.t_s * 1e9) + 1, tick=round(500 * self.t_s),
            state=State.ENABLED if enabled else State.READY, trip_bits=0, speed_Hz=speed_Hz,
            turn_speed_Hz=speed_Hz if self.speed_Hz is None else self.speed_Hz,
            torque_set_Nm=self.demand.torque_Nm, plan_point=self.demand.plan_point,
            point_first_tick=1, point_first_t_ns=1, point_turns=1.0, point_speed_Hz=speed_Hz,
            channels={"winding_C": self.read(self.winding_C)},
        )  # fmt: skip
        self.demand = self.executor.advance(observed)
        self.seen.append(self.demand)

    def until(self, done: Callable[[], bool], looks: int = 6000) -> "Bench":
        for _ in range(looks):
            if done() or self.executor.finished:
                return self
            self.look()
        raise AssertionError("it does not end")

    def finish(self) -> "Bench":
        return self.until(lambda: self.executor.finished)

    @property
    def ends(self) -> list[str]:
        return [point["ended_by"] for point in self.executor.points]


def test_it_heats_until_steady_and_cools_without_current(config: Config) -> None:
    bench = Bench(config).finish()
    assert (bench.executor.state, bench.ends) == (PlanState.DONE, ["steady", "steady"])
    assert bench.executor.message == "heat-up: steady; cooling without current: steady"
    heating, cooling = bench.executor.points
    # the slope of 60 K exp(-t / 40 s) is 0.5 K/min once 5.2 time constants have passed
    assert heating["temperatures_C"]["winding_C"] == pytest.approx(84.7, abs=0.2)
    [slope, half] = heating["slopes_K_per_min"]["winding_C"]
    assert 0.0 < slope < slope + half <= 0.5
    assert cooling["temperatures_C"]["winding_C"] == pytest.approx(25.3, abs=0.2)
    cooled = [one for one in bench.seen if one.plan_point == 1]
    assert all((one.enabled, one.torque_Nm, one.brake) == (False, 0.0, 0.0) for one in cooled)
    assert any("winding_C" in one.label and "min left at most" in one.label for one in cooled)


def test_time_and_temperature_end_a_heat_up(config: Config) -> None:
    assert Bench(config, heating_max_s=60.0, cooling_max_s=40.0).finish().ends == ["time limit"] * 2
    hot = Bench(config, temperature_max_C=60.0).finish()
    assert hot.ends == ["temperature limit", "steady"]
    assert hot.executor.points[0]["temperatures_C"]["winding_C"] == pytest.approx(60.0, abs=1.0)


@pytest.mark.parametrize("why", ["no reading for 3.2 s", "not a number"])
def test_a_channel_without_a_value_ends_the_heat_up(config: Config, why: str) -> None:
    bench = heated(config)
    bench.read = lambda _: ChannelValue(bench.t_s, float("nan"), why)
    bench.look()
    assert bench.demand.torque_Nm == 0.0
    bench.finish()
    assert bench.executor.state is PlanState.FAILED
    assert bench.executor.message.startswith(f"winding_C has no valid value: {why}")


def heated(config: Config) -> Bench:
    bench = Bench(config)
    return bench.until(lambda: bench.winding_C > 44.0)


def test_a_channel_may_be_silent_for_a_while_as_it_cools(config: Config) -> None:
    bench = Bench(config)
    bench.until(lambda: len(bench.executor.points) == 1)
    good, until_s = bench.read, bench.t_s + 30.0
    bench.read = lambda value: replace(good(value), obstacle="silent" * (bench.t_s < until_s))
    assert bench.finish().executor.state is PlanState.DONE
    bench = Bench(config)
    bench.until(lambda: len(bench.executor.points) == 1)
    bench.read = lambda value: ChannelValue(bench.t_s, value, "silent")
    assert "winding_C has no valid value: silent" in bench.finish().executor.message


def test_a_channel_that_never_moves_ends_the_heat_up(config: Config) -> None:
    bench = Bench(config, steady_K_per_min=1e-9)
    bench.read = lambda _: ChannelValue(bench.t_s, 25.0)
    message = bench.finish().executor.message
    assert "winding_C gives the same 25 degC since the heat-up began" in message
    assert bench.t_s < 70.0


def test_a_channel_that_freezes_in_the_heat_up_ends_it(config: Config) -> None:
    bench = Bench(config)
    bench.until(lambda: bench.winding_C > 60.0)
    at_s = bench.t_s
    bench.read = lambda _: ChannelValue(bench.t_s, 60.0)
    message = bench.finish().executor.message
    assert message.startswith("winding_C gives the same 60 degC for 28 s, right after it moved by")
    assert "is it frozen?" in message
    assert bench.t_s - at_s < 31.0


def rounded(bench: Bench, resolution_K: float) -> None:
    """Have a bench read by steps."""
    bench.read = lambda value: ChannelValue(bench.t_s, resolution_K * round(value / resolution_K))


@pytest.mark.parametrize("resolution_K", [0.01, 0.03, 0.1, 0.2])
def test_a_coarse_channel_is_steady_when_it_is_and_not_before(
    config: Config, resolution_K: float
) -> None:
    bench = Bench(config)
    rounded(bench, resolution_K)
    bench.until(lambda: len(bench.executor.points) == 1)
    missing_K = 85.0 - bench.winding_C
    assert 60.0 * missing_K / 40.0 < 0.5  # the slope itself, K/min
    assert bench.finish().ends == ["steady", "steady"]


def test_a_channel_that_is_too_coarse_is_not_steady(config: Config) -> None:
    bench = Bench(config)
    rounded(bench, 1.0)
    assert bench.finish().ends == ["time limit", "time limit"]


def test_a_channel_that_freezes_in_the_cooling_is_not_steady(config: Config) -> None:
    bench = Bench(config)
    bench.until(lambda: len(bench.executor.points) == 1)
    bench.until(lambda: bench.winding_C < 50.0)
    bench.read = lambda _: ChannelValue(bench.t_s, 50.0)
    assert bench.finish().ends == ["steady", "time limit"]


@pytest.mark.parametrize("time_constant_s", [5.0, 10.0, 20.0, 40.0, 100.0, 300.0])
@pytest.mark.parametrize("resolution_K", [0.01, 0.1, 1.0])
def test_a_temperature_that_settles_is_not_suspected(
    time_constant_s: float, resolution_K: float
) -> None:
    window = ChannelWindow(30.0)
    for t_s in np.arange(0.0, 15 * time_constant_s + 100.0, 0.5):
        value_C = 80.0 - 60.0 * exp(-t_s / time_constant_s)
        step_C = resolution_K * round(value_C / resolution_K)
        window.take(ChannelValue(t_s, step_C))
        assert not window.may_be_frozen(0.5), (t_s, value_C, window.moved_K)


def test_a_channel_that_is_not_read_is_named(config: Config) -> None:
    bench = Bench(config, winding_channel="housing_C")
    assert "housing_C has no valid value: it is not read" in bench.finish().executor.message


@pytest.mark.parametrize(
    ("settings", "speed_Hz", "why"),
    [({}, 0.3, "not at 2: does the brake answer"), ({"speed_Hz": 0.0}, 0.3, "lock it")],
)
def test_a_rotor_that_turns_otherwise_ends_the_heat_up(
    config: Config, settings: dict[str, float], speed_Hz: float, why: str
) -> None:
    bench = Bench(config, **settings)
    bench.speed_Hz = speed_Hz
    assert why in bench.finish().executor.message


def test_a_locked_rotor_is_heated_without_the_brake(config: Config) -> None:
    bench = Bench(config, speed_Hz=0.0).finish()
    assert bench.executor.state is PlanState.DONE
    assert not any(one.brake for one in bench.seen)


def test_stop_and_pause(config: Config) -> None:
    bench = heated(config)
    bench.executor.pause()
    bench.until(lambda: bench.executor.state is PlanState.PAUSED)
    assert bench.demand.torque_Nm == 0.0
    bench.executor.resume()
    assert bench.finish().ends == ["steady", "steady"]
    bench = heated(config)
    bench.executor.abort()
    assert bench.finish().executor.state is PlanState.ABORTED
    assert bench.executor.points == []


def test_the_slope_has_an_interval_that_holds_for_correlated_noise() -> None:
    rng, t_s, held = np.random.default_rng(5), np.arange(200.0), 0
    for _ in range(200):
        noise = np.zeros(200)
        for n, kick in enumerate(rng.standard_normal(200)):
            noise[n] = 0.8 * noise[n - 1] + kick
        slope = slope_of(t_s, 0.01 * t_s + 0.1 * noise)
        held += abs(slope.K_per_min - 0.6) < slope.half_width_K_per_min
    assert 0.88 * 200 < held < 0.99 * 200


def test_a_fast_channel_costs_a_look_no_more_than_a_slow_one() -> None:
    rng = np.random.default_rng(4)
    slow, fast = ChannelWindow(60.0), ChannelWindow(60.0)
    for number in range(60_000):
        t_s = number / 500
        value_C = 40.0 + 0.01 * t_s + 0.05 * rng.normal()
        fast.take(ChannelValue(t_s, value_C))
        if number % 60 == 0:
            slow.take(ChannelValue(t_s, value_C))
    assert len(fast._readings) <= 2 * READINGS_KEPT + 2
    assert fast.slope is not None
    assert slow.slope is not None
    assert fast.slope.K_per_min == pytest.approx(0.6, abs=0.05)
    assert 0.5 < fast.slope.half_width_K_per_min / slow.slope.half_width_K_per_min < 2


def test_what_its_steps_need_is_loaded_while_the_plan_is_made(
    config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[int] = []
    monkeypatch.setattr("motord.experiments.thermal.plan.coverage_factor", lambda: loaded.append(1))
    build("thermal", config, SMALL)
    assert loaded == [1]
