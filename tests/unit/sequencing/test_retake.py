"""Operating points of poor quality are taken again, whatever plan they belong to."""

import pytest

from motord.schema import State
from motord.sequencing import Demand, Executor, OperatingPoint, Plan, PlanState
from motord.sequencing.capture import TAKES_MAX, final, retaken_if_poor
from tests.unit.sequencing.test_executor import Runner


def run(*qualities):
    """Return the executor after a plan of points with these qualities, take by take.

    Then how often each point was begun, and what the plan got of it.
    """
    begun, results = [0] * len(qualities), {}

    def scripted(index):
        yield Demand(torque_Nm=1.0)
        begun[index] += 1
        return {"index": index, "quality": qualities[index][begun[index] - 1]}

    def motion(points):
        for point in points:
            results[point.index] = yield from retaken_if_poor(scripted, point.index)

    points = tuple(OperatingPoint(i, 1.0, 1.0, 1) for i in range(len(qualities)))
    executor = Executor(Plan("scripted", points, motion, lambda point: 1.0, {}))
    runner = Runner()
    block = runner.bench.look(Demand())
    while not executor.finished:
        executor.advance(runner.watcher.take(block))
    return executor, begun, results


@pytest.mark.parametrize(
    ("qualities", "takes"),
    [
        (["ok"], 1),
        (["noisy", "ok"], 2),
        (["noisy", "noisy", "ok"], 3),
        (["noisy"] * TAKES_MAX, TAKES_MAX),
    ],
)
def test_a_poor_point_is_taken_again_until_it_is_good_or_it_is_enough(qualities, takes):
    executor, begun, results = run(qualities, ["ok"])
    assert begun == [takes, 1]
    assert [(p["index"], p["take"]) for p in executor.points] == [
        *((0, n + 1) for n in range(takes)), (1, 1),
    ]  # fmt: skip
    assert [p["quality"] for p in executor.points] == [*qualities, "ok"]
    assert executor.points_done == executor.progress()["points_done"] == 2
    assert executor.state is PlanState.DONE
    assert [final(p) for p in executor.points[:takes]] == [False] * (takes - 1) + [True]
    assert results[0]["quality"] == qualities[-1]  # the plan gets the last one only


def test_points_of_older_recordings_are_their_only_take():
    assert final({"index": 0})
    assert final({"index": 0, "quality": "ok"})
    assert not final({"index": 0, "quality": "speed off by 5 %"})


def disturbed(strength):
    """Return a runner at its first point whose brake is `strength` times as strong, held so."""
    runner = Runner(settings={"torques_Nm": [2.0], "speeds_Hz": [1.0], "turns": 8, "settle_s": 0.5})
    runner.until(lambda: runner.demand.plan_point == 0)
    runner.bench.brake_factor *= strength
    return runner


def test_a_speed_that_drifts_while_it_is_captured_is_taken_again():
    runner = disturbed(1.2)
    runner.finish()
    bad, good = runner.executor.points
    assert (bad["take"], good["take"], bad["index"], good["index"]) == (1, 2, 0, 0)
    assert "speed off" in bad["quality"]
    assert good["quality"] == "ok"
    assert good["tick_start"] > bad["tick_end"]
    assert runner.executor.state is PlanState.DONE
    assert runner.bench.state is State.READY


def test_a_pause_in_a_second_take_leaves_it_the_second():
    runner = disturbed(1.2)
    runner.until(lambda: len(runner.executor.points) == 1)
    runner.until(lambda: runner.demand.plan_point == 0)
    runner.executor.pause()
    runner.until(lambda: runner.executor.state is PlanState.PAUSED)
    runner.executor.resume()
    runner.finish()
    assert [p["take"] for p in runner.executor.points] == [1, 2]


def test_an_abort_in_a_second_take_ends_the_plan():
    runner = disturbed(1.2)
    runner.until(lambda: len(runner.executor.points) == 1)
    runner.executor.abort()
    runner.finish()
    assert runner.executor.state is PlanState.ABORTED
    assert runner.executor.points_done == 0
