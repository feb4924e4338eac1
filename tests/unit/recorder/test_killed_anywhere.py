"""No tick of a powered bench is lost, or in two files, wherever the recorder is killed.

Nor is what is recorded as a recording ends.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import numpy as np
import pytest

from motord.api.plan_messages import PlanView
from motord.schema import State
from motord.sequencing.demand import OperatingPoint
from motord.sequencing.motions import Motion
from motord.sequencing.plan import Plan
from tests.unit.recorder.lives import MARGIN_STEPS, STEP_TICKS, Bench, ticks_of, timings_of

pytestmark = pytest.mark.slow

SOON, LATE = 1, 2 * MARGIN_STEPS
"""When a killed recorder has a successor: at once, or when what it recorded has ended."""


def _no_motion(_points: tuple[OperatingPoint, ...]) -> Motion[None]:
    yield from ()


PLAN = Plan("verify", points=(), motion=_no_motion, point_s=lambda _: 0.0, settings={})
VIEW = PlanView(plan="verify", state="done", started_by="anna", run_id="1")


def twice(bench: Bench) -> None:
    """Powered by hand: the second time follows what is recorded of the first."""
    bench.step(2)
    bench.enabled(3)
    bench.step(MARGIN_STEPS + 2)
    bench.enabled(3)


def by_hand(bench: Bench) -> None:
    """Three times powered, the third time late."""
    twice(bench)
    bench.step(3 * MARGIN_STEPS)
    bench.enabled(3)


def with_a_plan(bench: Bench) -> None:
    """Manual operation, a plan in the midst of it, manual operation."""
    bench.step(2)
    bench.enabled(3)
    bench.control.plan_started(PLAN, VIEW, "")
    bench.enabled(4)
    bench.state = State.ENABLED
    bench.control.plan_over(VIEW)
    bench.enabled(3)


Operate = Callable[[Bench], None]
OPERATIONS = pytest.mark.parametrize("operate", [by_hand, with_a_plan])
AWAY = pytest.mark.parametrize("away_steps", [SOON, LATE], ids=["soon", "late"])


@pytest.fixture
def make(tmp_path_factory) -> Iterator[Callable[..., Bench]]:
    """Return what makes a bench, one at a time."""
    with pytest.MonkeyPatch.context() as patch, ExitStack() as opened:

        def make(away_steps: int, kill_at: int | None = None) -> Bench:
            opened.close()
            patch.undo()
            bench = Bench(tmp_path_factory.mktemp("bench"), patch, away_steps)
            bench.kill_at = kill_at
            opened.callback(bench.close)
            return bench

        yield make


def check(bench: Bench, where: str) -> None:
    """Every tick from shortly before the bench was powered until shortly after it, once.

    And in each recording the one event with which it ends.
    """
    runs, ticks = bench.runs(), bench.ticks
    timings = {name: timings_of(files) for name, files in runs.items()}
    assert set(timings.values()) == {1}, (where, timings)
    recorded = {name: ticks_of(files) for name, files in runs.items()}
    numbers = np.concatenate([block["tick"] for block in recorded.values()])
    assert len(np.unique(numbers)) == len(numbers), where
    powered = ticks["tick"][ticks["state"] == State.ENABLED].astype(int)
    margin = MARGIN_STEPS * STEP_TICKS
    wanted = powered[:, None] + np.arange(-margin, margin - STEP_TICKS)
    missing = np.setdiff1d(np.intersect1d(ticks["tick"], wanted), numbers)
    assert not missing.size, (where, missing)
    for name, block in recorded.items():
        if not len(block):
            continue
        first, last = np.searchsorted(ticks["tick"], block["tick"][[0, -1]])
        assert np.array_equal(block["tick"], ticks["tick"][first : last + 1]), (where, name)


def let_it_end(bench: Bench) -> None:
    """Go on until the recorder, or its successor, has nothing left to do."""
    bench.step(2 * LATE)
    bench.kill_at = bench.disk.fatal = None
    bench.end()


@OPERATIONS
def test_without_a_kill_all_is_recorded_and_closed(make, operate: Operate):
    bench = make(SOON)
    operate(bench)
    let_it_end(bench)
    check(bench, "no kill")
    assert not list(bench.settings.directory.glob("*.part"))
    assert not bench.events.recent()


@pytest.mark.parametrize("pause_steps", [MARGIN_STEPS, 2 * MARGIN_STEPS + 2])
def test_ticks_between_two_recordings_are_not_recorded_and_none_is_missed(make, pause_steps: int):
    """So recordings that do not follow each other say nothing of what the loop missed."""
    bench = make(SOON)
    for _ in range(2):
        bench.enabled(3)
        bench.step(pause_steps)
    bench.end()
    first, second = bench.recorded().values()
    gap = int(second["tick"][0]) - int(first["tick"][-1]) - 1
    missed = int(second["missed"][0]) - int(first["missed"][-1])
    assert (gap > missed) is (pause_steps > MARGIN_STEPS)


@pytest.mark.parametrize(
    "operate", [twice, with_a_plan, pytest.param(by_hand, marks=pytest.mark.long)]
)
@AWAY
def test_a_kill_at_any_call_of_the_system(make, operate: Operate, away_steps: int):
    bench = make(away_steps)
    operate(bench)
    let_it_end(bench)
    calls = bench.disk.calls
    assert calls > 30
    for call in range(1, calls):
        bench = make(away_steps)
        bench.disk.fatal, bench.disk.part = call, call % 3 / 2
        operate(bench)
        let_it_end(bench)
        check(bench, f"call {call}")


@OPERATIONS
@AWAY
def test_a_kill_between_any_two_steps(make, operate: Operate, away_steps: int):
    bench = make(away_steps)
    operate(bench)
    for step in range(1, bench.steps + 1):
        bench = make(away_steps, step)
        operate(bench)
        let_it_end(bench)
        assert bench.kills == 1
        check(bench, f"step {step}")


@OPERATIONS
@AWAY
def test_a_kill_right_before_the_daemon_ends(make, operate: Operate, away_steps: int):
    """What is missing is recorded before the ring goes with the daemon."""
    bench = make(away_steps)
    operate(bench)
    steps = bench.steps
    for since in range(away_steps + 1):
        bench = make(away_steps, steps - since)
        operate(bench)
        bench.end()
        assert bench.kills == 1
        check(bench, f"{since} steps before")
        assert not bench.events.recent()
