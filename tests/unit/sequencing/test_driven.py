"""The externally driven plans on the simulated rig, and on a drive that ignores commands."""

from dataclasses import replace

import numpy as np
import pytest

from motord.config import load
from motord.experiments.plans import build
from motord.schema import State
from motord.sequencing import Demand, Executor, PlanError, PlanState, TickWatcher
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan
from tests.unit.control.bench import make_config
from tests.unit.sequencing.fakes import FakeBench

SHORT = {"speeds_Hz": [0.5, 1.0], "turns": 3, "settle_s": 0.5}


@pytest.fixture(scope="module")
def driven() -> tuple[list[dict], np.ndarray, np.ndarray, float]:
    """Points, ticks, truth and estimated time of a short cogging plan."""
    bench = VirtualBench(load(), seed=2)
    plan = build("cogging", bench.config, SHORT)
    blocks: list[tuple[np.ndarray, np.ndarray]] = []
    points = run_plan(bench, plan, lambda *block: blocks.append(block))
    ticks, truth = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    return points, ticks, truth, plan.seconds


def test_every_speed_is_taken_without_current(driven: tuple) -> None:
    points, ticks, truth, _ = driven
    assert [p["speed_Hz"] for p in points] == [0.5, 1.0]
    for point in points:
        captured = ticks["plan_point"] == point["index"]
        assert point["quality"] == "ok"
        assert point["driven"] is True
        assert 3.0 <= point["turns"] < 3.2
        assert set(ticks["state"][captured]) == {int(State.READY)}
        assert not truth["inverter_on"][captured].any()
        assert np.abs(truth["i_a_A"][captured]).max() == 0.0
        mean_Hz = truth["speed_rad_s"][captured].mean() / (2 * np.pi)
        assert mean_Hz == pytest.approx(point["speed_Hz"], rel=0.01)


def test_the_rotor_is_not_caught_in_large_swings(driven: tuple) -> None:
    points, ticks, truth, _ = driven
    speed_Hz = truth["speed_rad_s"][ticks["plan_point"] == points[0]["index"]] / (2 * np.pi)
    assert 0.35 < speed_Hz.min() < speed_Hz.max() < 0.65


def test_the_rotor_stands_at_the_end(driven: tuple) -> None:
    _, ticks, truth, estimate_s = driven
    assert ticks["drive_set_rad_s"][-1] == 0.0
    assert abs(truth["speed_rad_s"][-1]) < 0.5
    took_s = (ticks["t_ns"][-1] - ticks["t_ns"][0]) * 1e-9
    assert estimate_s == pytest.approx(took_s, rel=0.3)


@pytest.mark.parametrize("name", ["cogging", "back-emf"])
def test_speeds_beyond_the_limits_are_refused(name: str) -> None:
    config = load()
    with pytest.raises(PlanError, match=r"4 Hz is above .* Hz, 80 % of \[limits\]"):
        build(name, config, {"speeds_Hz": [0.5, 4.0]})
    with pytest.raises(PlanError, match=r"2.5 Hz is faster than the drive can turn"):
        build(name, config, {"speeds_Hz": [2.5]})
    with pytest.raises(PlanError, match="setting torque_Nm"):
        build(name, config, {"torque_Nm": 1.0})


def test_spin_up_stays_within_the_drives_limit() -> None:
    bench = VirtualBench(load(), seed=2)
    demanded = []
    plan = build("back-emf", bench.config, {"speeds_Hz": [2.2], "turns": 2, "settle_s": 0.2})
    run_plan(bench, plan, lambda ticks, truth: demanded.append(ticks["drive_set_rad_s"].max()))
    assert max(demanded) == pytest.approx(15.0)


class Driven:
    """A fake bench whose rotor turns as fast as `answer` makes of the drive's speed."""

    def __init__(self, answer, **settings: object) -> None:
        config = make_config()
        self.bench = FakeBench(config.brake)
        self.answer = answer
        plan = build("cogging", config, {**SHORT, "settle_timeout_s": 6.0, **settings})
        self.executor = Executor(plan)
        self.watcher = TickWatcher()
        self.demand = Demand()

    def look(self) -> None:
        speed_rad_s = self.answer(self.demand.drive_rad_s, self.bench.number)
        self.bench.speed_rad_s = abs(speed_rad_s)
        block = self.bench.look(replace(self.demand, brake=0.0))
        block["speed_rad_s"] = speed_rad_s
        self.demand = self.executor.advance(self.watcher.take(block))

    def finish(self, looks: int = 20_000) -> str:
        for _ in range(looks):
            if self.executor.finished:
                break
            self.look()
        assert self.executor.finished
        return self.executor.message


def test_a_belt_that_creeps_a_little_is_taken() -> None:
    driven = Driven(lambda drive, _: 0.97 * drive)
    assert driven.finish() == ""
    assert driven.executor.state is PlanState.DONE
    assert [p["quality"] for p in driven.executor.points] == ["ok", "ok"]


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (lambda drive, _: 0.0, "does the drive answer, is the belt on"),
        (lambda drive, _: -drive, "it turns the other way"),
        (lambda drive, _: 0.7 * drive, "does the belt slip, is the drive's scale right"),
        (lambda drive, n: drive * (1 + 0.04 * np.sin(n / 300)), "it does not hold still"),
    ],
)
def test_a_speed_that_is_not_reached_is_reported(answer, expected: str) -> None:
    message = Driven(answer, settle_s=20.0, settle_timeout_s=25.0).finish()
    assert expected in message
    assert message.startswith("driven at 0.5 Hz")


def test_a_rotor_that_stops_in_the_capture_is_reported() -> None:
    driven = Driven(lambda drive, _: drive)
    while driven.demand.plan_point < 0:
        driven.look()
    driven.answer = lambda drive, _: 0.0
    assert "the rotor stopped turning" in driven.finish()
    assert driven.demand.drive_rad_s == 0.0


def test_a_speed_that_drifts_away_in_the_capture_is_reported() -> None:
    driven = Driven(lambda drive, _: drive)
    while driven.demand.plan_point < 0:
        driven.look()
    driven.answer = lambda drive, _: 0.8 * drive
    driven.finish()
    assert driven.executor.points[0]["quality"].startswith("speed off by")


@pytest.mark.parametrize(
    ("swing", "expected"),
    [(0.12, "ok"), (0.25, "not settled: turns from 0.3")],
    ids=["small", "big"],
)
def test_a_speed_that_swings_about_its_mean_in_the_capture_has_not_settled(swing, expected) -> None:
    driven = Driven(lambda drive, _: drive, turns=12)
    while driven.demand.plan_point < 0:
        driven.look()
    begun, turn = driven.bench.number, 200  # ticks of a turn at 0.5 Hz
    driven.answer = lambda drive, n: (
        drive * (1 + swing * np.sin(2 * np.pi * (n - begun) / (6 * turn)))
    )
    while not driven.executor.points:
        driven.look()
    assert driven.executor.points[0]["quality"].startswith(expected)


def test_a_poor_driven_point_is_taken_again_and_marked() -> None:
    driven = Driven(lambda drive, _: drive, temperature_C=[30.0, 50.0], speeds_Hz=[0.5])
    driven.finish()
    takes = [(p["take"], p["quality"].partition(",")[0]) for p in driven.executor.points]
    assert takes == [(take, "inverter at 0.0 degC") for take in (1, 2, 3)]


def test_a_stop_by_somebody_else_ends_it() -> None:
    driven = Driven(lambda drive, _: drive)
    while driven.demand.plan_point < 0:
        driven.look()
    driven.bench.state = State.OFF
    assert "the bench was stopped" in driven.finish()


def test_a_drive_that_is_slow_has_as_long_to_stop_as_to_settle() -> None:
    turns_rad_s = 0.0

    def answer(drive_rad_s: float, _: int) -> float:
        nonlocal turns_rad_s
        turns_rad_s = max(drive_rad_s, turns_rad_s - 0.0014)  # from 0.5 Hz to rest in 45 s
        return turns_rad_s

    driven = Driven(answer, speeds_Hz=[0.5], settle_timeout_s=60.0)
    assert driven.finish() == ""
    assert driven.executor.state is PlanState.DONE


def test_a_drive_that_does_not_stop_is_reported() -> None:
    driven = Driven(lambda drive, _: max(drive, 3.0), speeds_Hz=[0.5])
    assert "the drive did not stop" in driven.finish()


def test_a_pause_stops_the_drive_and_resume_takes_the_point_again() -> None:
    driven = Driven(lambda drive, _: drive)
    while driven.demand.plan_point < 0:
        driven.look()
    driven.executor.pause()
    for _ in range(10):
        driven.look()
    assert driven.executor.state is PlanState.PAUSED
    assert driven.demand.drive_rad_s == 0.0
    assert driven.demand.plan_point == -1
    driven.executor.resume()
    assert driven.finish() == ""
    assert len(driven.executor.points) == 2


def test_an_abort_stops_the_drive() -> None:
    driven = Driven(lambda drive, _: drive)
    while driven.demand.plan_point < 0:
        driven.look()
    driven.executor.abort("enough")
    assert driven.finish() == "enough"
    assert driven.demand.drive_rad_s == 0.0
