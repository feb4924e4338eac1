"""Profiles on the simulated rig: what is accepted is played without a trip, within all limits."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import find, given, settings
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from motord.config import Config, load
from motord.control.types import SETPOINT
from motord.experiments.profile import plan as profile_plan
from motord.schema import State, Trip
from motord.sequencing import Demand, Executor, Plan, PlanError, PlanState, TickWatcher
from motord.virtual import VirtualBench
from motord.virtual.plan import _put
from tests.unit.experiments.profile.profiles import SMALL, Rows, changed, made, played

BENCH = changed(limits={"i2t_current_A": 9.0, "i2t_time_s": 1.0, "torque_rate_Nm_per_s": 8.0})
"""A bench whose limits a short profile can reach."""

ASTRAY = "further off than speed_error_max_Hz"
"""How a plan ends whose rotor cogging holds fast: no interlock's business."""


def profiles(
    steps_s: SearchStrategy[float],
    torques_Nm: SearchStrategy[float],
    speeds_Hz: SearchStrategy[float],
    rows: int = 6,
) -> SearchStrategy[Rows]:
    """Draw profiles of a few rows from standstill, torque and speed of one sign."""

    def signed(drawn: list[tuple[float, float, float]], sign: int) -> Rows:
        times_s = np.cumsum([step_s for step_s, _, _ in drawn]).tolist()
        inner = [
            (t, sign * torque_Nm, sign * speed_Hz)
            for t, (_, torque_Nm, speed_Hz) in zip(times_s, drawn, strict=True)
        ]
        return [(0.0, 0.0, 0.0), *inner]

    row = st.tuples(steps_s, torques_Nm, speeds_Hz)
    return st.builds(signed, st.lists(row, min_size=1, max_size=rows), st.sampled_from([1, -1]))


def tripped(folder: Path, rows: Rows, config: Config = BENCH) -> str:
    """Play a profile; return what tripped, "" if nothing did or the profile is refused."""
    try:
        plan = made(folder / "p.csv", rows, config)
    except PlanError:
        return ""
    PLAYED.append(rows)
    ticks, said = played(plan, config)
    if said and ASTRAY not in said:
        return said
    assert not ticks["trip_bits"].any()
    limits = config.limits
    assert np.abs(ticks["torque_set_Nm"]).max() <= limits.torque_Nm
    assert np.abs(np.diff(ticks["torque_set_Nm"])).max() * 1000 <= limits.ramp_down_Nm_per_s * 1.001
    assert max(np.abs(ticks[f"i_cmd_{p}_A"]).max() for p in "abc") <= limits.current_A
    assert np.abs(ticks["speed_rad_s"]).max() < limits.trip_speed_rad_s
    return ""


PLAYED: list[Rows] = []
"""Profiles that were accepted."""


@settings(max_examples=60)
@given(
    rows=profiles(
        st.sampled_from([0.5, 1.0, 2.0, 4.0]),
        st.one_of(st.just(0.0), st.floats(0.5, 5).map(lambda torque_Nm: round(torque_Nm, 2))),
        st.one_of(st.just(0.0), st.floats(0.4, 1.63).map(lambda speed_Hz: round(speed_Hz, 2))),
    )
)
def test_what_is_accepted_never_trips(tmp_path_factory: pytest.TempPathFactory, rows: Rows) -> None:
    assert tripped(tmp_path_factory.getbasetemp(), rows) == ""


def test_many_of_these_were_accepted_and_some_refused() -> None:
    if PLAYED:
        assert len(PLAYED) > 15


def test_without_its_checks_one_trips_and_the_search_finds_the_smallest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    coarse = profiles(st.just(4.0), st.sampled_from([0, 5]), st.just(1.0), rows=2)
    few = settings(max_examples=20, database=None, deadline=None, derandomize=True)
    monkeypatch.setattr(profile_plan, "check", lambda *_, **__: None)
    trips = cache(lambda rows: tripped(tmp_path, rows) != "")
    rows = find(coarse, lambda rows: trips(tuple(rows)), settings=few)
    playing = f"profile: the bench tripped: {Trip.I2T.name} (step: cycle 1 of 1: playing)"
    assert tripped(tmp_path, rows) == playing
    assert rows == [(0.0, 0.0, 0.0), (4.0, 5, 1.0), (8.0, 5, 1.0)]
    monkeypatch.undo()
    assert tripped(tmp_path, rows) == ""


def test_a_profile_is_followed_in_both_directions(tmp_path: Path) -> None:
    rows = [*SMALL, *((t + 6, -torque_Nm, -speed_Hz) for t, torque_Nm, speed_Hz in SMALL[1:])]
    ticks, said = played(made(tmp_path / "p.csv", rows))
    assert said == ""
    inside = ticks[ticks["plan_point"] == 0]
    assert inside.size == pytest.approx(12_000, abs=60)
    t_s = (inside["t_ns"] - inside["t_ns"][0]) * 1e-9
    for begin_s, end_s, torque_Nm, speed_Hz in ((2.5, 4, 2, 0.8), (8.5, 10, -2, -0.8)):
        held = inside[(t_s > begin_s) & (t_s < end_s)]
        assert held["torque_set_Nm"].mean() == pytest.approx(torque_Nm, abs=1e-3)
        assert held["speed_rad_s"].mean() / (2 * np.pi) == pytest.approx(speed_Hz, rel=0.05)
        assert held["speed_set_rad_s"].mean() / (2 * np.pi) == pytest.approx(speed_Hz, rel=1e-3)
    assert ticks["state"][-1] == State.READY


def test_a_profile_may_begin_and_end_in_motion(tmp_path: Path) -> None:
    plan = made(tmp_path / "p.csv", [(10, 3, 1), (13, 2, 0.8)], repeats=2)
    ticks, said = played(plan)
    assert said == ""
    for cycle in (0, 1):
        speed_Hz = ticks["speed_rad_s"][ticks["plan_point"] == cycle] / (2 * np.pi)
        assert speed_Hz.size == pytest.approx(3000, abs=60)
        assert speed_Hz[:400].mean() == pytest.approx(1.0, rel=0.06)
        assert speed_Hz[-400:].mean() == pytest.approx(0.8, rel=0.06)


def test_a_rotor_that_does_not_follow_ends_the_plan(tmp_path: Path) -> None:
    plan = made(tmp_path / "p.csv", [(0, 0, 0), (2, 0.1, 0.9), (9, 0.1, 0.9)])
    ticks, said = played(plan)
    assert ASTRAY in said
    assert "is the rotor free" in said
    assert ticks["state"][-1] == State.READY
    assert not ticks["trip_bits"].any()


class Steered:
    """A plan on the simulated rig, look by look."""

    def __init__(self, plan: Plan) -> None:
        self.executor, self.watcher = Executor(plan), TickWatcher()
        self.bench, self.setpoint = VirtualBench(load()), np.zeros(1, SETPOINT)
        self.setpoint["plan_point"] = -1
        self.demand, self.ticks = Demand(), np.zeros(0)

    def until(self, end: Any) -> None:
        for _ in range(2000):
            self.ticks, _ = self.bench.run(self.setpoint, 50)
            before, self.demand = self.demand, self.executor.advance(self.watcher.take(self.ticks))
            _put(self.setpoint, before, self.demand)
            if end(self):
                return
        raise AssertionError(self.executor.progress())


def test_after_a_pause_the_cycle_is_played_from_its_beginning(tmp_path: Path) -> None:
    run = Steered(made(tmp_path / "p.csv", SMALL, repeats=2))
    run.until(lambda run: run.executor.points_done == 1 and run.demand.torque_Nm > 1)
    run.executor.pause()
    run.until(lambda run: run.executor.state is PlanState.PAUSED)
    run.until(lambda run: run.ticks["torque_set_Nm"][-1] == 0.0)
    run.executor.resume()
    run.until(lambda run: run.executor.finished)
    assert run.executor.state is PlanState.DONE
    first, second = run.executor.points
    assert (first["index"], second["index"]) == (0, 1)
    span_s = (second["t_end_ns"] - second["t_start_ns"]) * 1e-9
    assert span_s == pytest.approx(6.0, abs=0.06)


def test_an_aborted_profile_ramps_down(tmp_path: Path) -> None:
    run = Steered(made(tmp_path / "p.csv", SMALL, repeats=2))
    run.until(lambda run: run.demand.torque_Nm > 1.5)
    run.executor.abort()
    run.until(lambda run: run.executor.finished)
    assert run.executor.state is PlanState.ABORTED
    assert run.executor.points == []
    run.until(lambda run: run.ticks["state"][-1] == State.READY)
    assert run.ticks["torque_set_Nm"][-1] == 0.0


def test_what_is_missing_is_made_of_the_same_file_alone(tmp_path: Path) -> None:
    plan = made(tmp_path / "p.csv", SMALL, repeats=3)
    rest = plan.part(plan.points[1:])
    _, said = played(rest)
    assert said == ""
    again = profile_plan.make(load(), plan.settings)
    assert again.points == plan.points
    (tmp_path / "p.csv").write_text("time_s,torque_Nm,speed_Hz\n0,0,0\n1,1,1\n")
    with pytest.raises(PlanError, match="its content has changed"):
        profile_plan.make(load(), plan.settings)
