"""The plan `align`: what it does to the bench, and what it refuses."""

import numpy as np
import pytest

from motord.config import Config, load
from motord.control.types import SETPOINT
from motord.experiments.alignment.plan import vector_A
from motord.experiments.plans import build
from motord.schema import State
from motord.sequencing import Demand, Executor, PlanError, TickWatcher
from motord.virtual import VirtualBench
from motord.virtual.plan import PlanFailed, run_plan
from tests.campaigns.align import random_case

SHORT = {"turns": 1, "rests": 13, "hold_s": 0.2, "currents_A": [6.0]}


def changed(**tables: dict[str, object]) -> Config:
    content = load().model_dump()
    for table, values in tables.items():
        content[table] |= values
    return Config.model_validate(content)


@pytest.fixture(scope="module")
def run() -> tuple[list[dict], np.ndarray, np.ndarray, float]:
    bench = VirtualBench(load(), random_case(1).truth(), seed=1)
    plan = build("align", bench.config, SHORT)
    blocks: list[tuple[np.ndarray, np.ndarray]] = []
    points = run_plan(bench, plan, lambda *block: blocks.append(block))
    ticks, truth = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    return points, ticks, truth, plan.seconds


def test_each_sweep_is_a_point_with_its_current_and_way(run: tuple) -> None:
    points, ticks, _, seconds = run
    assert [p["sweep"] for p in points] == [
        {"amplitude_A": 6.0, "way": 1},
        {"amplitude_A": 6.0, "way": -1},
    ]
    assert all(p["turns"] == pytest.approx(1 / 8, abs=0.03) for p in points)
    assert ticks.size / 1000 == pytest.approx(seconds, rel=0.15)


def test_the_current_never_exceeds_what_was_asked_and_ends(run: tuple) -> None:
    _, ticks, truth, _ = run
    commands_A = np.stack([ticks[f"i_cmd_{p}_A"] for p in "abc"])
    assert 5.9 < np.abs(commands_A).max() <= 6.0 + 1e-5
    assert np.abs(commands_A.sum(axis=0)).max() < 1e-5
    assert not commands_A[:, -5:].any()
    assert not ticks["torque_set_Nm"].any()
    assert set(ticks["trip_bits"][ticks["state"] == State.ENABLED]) == {0}
    assert not truth["inverter_on"][-1]


def test_the_vector_goes_to_each_stop_and_back(run: tuple) -> None:
    points, ticks, _, _ = run
    for point in points:
        own = ticks[ticks["plan_point"] == point["index"]]
        commands_A = np.stack([own[f"i_cmd_{p}_A"] for p in "abc"], axis=1).astype(float)
        ends = [commands_A[150], commands_A[-1]]
        np.testing.assert_allclose(ends, [vector_A(6.0, 0.0)] * 2, atol=1e-4)
        steps = np.abs(np.diff(commands_A, axis=0)).max(axis=1)
        assert steps.max() < 2 * 6.0 * np.sin(np.pi / 13)


def test_the_usual_currents_are_parts_of_the_rated_one() -> None:
    config = load()
    rated_A = 2 / 3 * config.motor.rated_torque_Nm / 0.206
    asked = build("align", config).settings["currents_A"]
    assert asked == pytest.approx([0.2 * rated_A, 0.4 * rated_A], rel=0.01)
    motor = config.motor.model_copy(update={"rated_torque_Nm": config.motor.rated_torque_Nm / 1e3})
    small = build("align", config.model_copy(update={"motor": motor})).settings["currents_A"]
    assert small == pytest.approx([asked[0] / 1e3, asked[1] / 1e3], rel=0.01)
    assert build("align", config, {"currents_A": [5, 2]}).settings["currents_A"] == [2, 5]


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (
            {"currents_A": [31.0]},
            r"31 A is more than may flow for long, \[limits\] i2t_current_A = 22",
        ),
        ({"currents_A": [3.0, 22.1]}, r"22.1 A is more than may flow for long"),
        ({"rests": 4}, "setting rests"),
        ({"current_A": 4}, "setting current_A.*settings are: currents_A, turns"),
    ],
)
def test_refused(settings: dict[str, object], expected: str) -> None:
    with pytest.raises(PlanError, match=expected):
        build("align", load(), settings)


def test_a_measured_table_has_nothing_to_align() -> None:
    table = {"k_V_s_per_rad": load().motor.back_emf_table().tolist()}
    with pytest.raises(PlanError, match="measured table"):
        build("align", changed(motor={"back_emf": table}))


def test_a_drive_with_an_angle_of_its_own_aligns_itself() -> None:
    config = load()
    inverter = config.inverter.model_copy(update={"driver": "can-dq"})
    with pytest.raises(PlanError, match="align it by its own tool"):
        build("align", config.model_copy(update={"inverter": inverter}))


def fails(expected: str, config: Config, current_A: float, **truth: dict[str, object]) -> None:
    bench = VirtualBench(config, random_case(0).truth(**truth), seed=0)
    plan = build("align", config, {**SHORT, "currents_A": [current_A]})
    with pytest.raises(PlanFailed, match=expected):
        run_plan(bench, plan, lambda *_: None)


@pytest.mark.parametrize("current_A", [3.0, 9.0, 20.0])
def test_a_rotor_that_is_held_fails(current_A: float) -> None:
    held = {"static_Nm": 9.0, "coulomb_Nm": 9.0}
    expected = "is it free, are all three phases connected, is the current"
    fails(expected, load(), current_A, rotor=held)


def test_a_rotor_that_goes_too_far_fails() -> None:
    config = changed(motor={"pole_pairs": 24, "slots": 144})
    fails("further than the current vector takes it with .* pole_pairs = 24", config, 6.0)


def test_a_pause_takes_the_current_away_and_the_sweep_begins_anew() -> None:
    bench = VirtualBench(load(), random_case(1).truth(), seed=1)
    executor, watcher = Executor(build("align", bench.config, SHORT)), TickWatcher()
    ticks = bench.run(np.zeros(1, SETPOINT), 50)[0]
    demands: list[Demand] = []
    ticks["state"] = State.ENABLED
    for look in range(400):
        ticks["t_ns"] += 50_000_000
        if look == 100:
            executor.pause()
        if look == 110:
            assert not any(demands[-1].induced.offset_A)
            executor.resume()
        demands.append(executor.advance(watcher.take(ticks)))
        if look == 111:
            break
    assert any(demands[99].induced.offset_A)
    assert np.linalg.norm(demands[-1].induced.offset_A) < 0.3 * 6.0
    executor.abort()
    assert not any(executor.advance(watcher.take(ticks)).induced.offset_A)


def test_a_supervisor_that_was_kept_from_running_does_not_make_the_vector_jump() -> None:
    executor, watcher = Executor(build("align", load(), SHORT)), TickWatcher()
    ticks = VirtualBench(load(), seed=1).run(np.zeros(1, SETPOINT), 50)[0]
    ticks["state"] = State.ENABLED
    before = np.zeros(3)
    for look in range(200):
        ticks["t_ns"] += 5_000_000_000 if look % 20 == 7 else 50_000_000
        demand = executor.advance(watcher.take(ticks))
        offset_A = np.array(demand.induced.offset_A)
        if before.any() and not offset_A.any():
            break  # the end of the sweep
        assert np.abs(offset_A - before).max() < 6.0 * 2 * np.sin(np.pi / 13) + 1e-9
        before = offset_A
    assert look > 30
