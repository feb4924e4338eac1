"""Motions on their own: what they yield, receive and return, and where they are begun again."""

import numpy as np
import pytest

from motord.schema import TICK_DTYPE, State
from motord.sequencing import (
    Demand,
    Executor,
    Induced,
    OperatingPoint,
    Plan,
    PlanState,
    TickWatcher,
)
from motord.sequencing.capture import account, capture
from motord.sequencing.motions import (
    MotionFailed,
    Restarted,
    guarded,
    hold,
    near_speed,
    restartable,
    wait,
    within,
)

LOOK_S = 0.1


def observations(count=100, state=State.READY, **columns):
    """Return observations LOOK_S apart, from the one at 1 s on."""
    watcher, seen = TickWatcher(), []
    for number in range(count):
        tick = np.zeros(1, TICK_DTYPE)
        tick["t_ns"] = round((1 + number * LOOK_S) * 1e9)
        tick["state"] = state
        for name, values in columns.items():
            tick[name] = values[number]
        seen.append(watcher.take(tick))
    return seen


def carry_out(motion, seen):
    """Return what is demanded after each observation, and what the motion returns."""
    demands = []
    try:
        asked = next(motion)
        for each in seen:
            if demands or asked is None:
                asked = motion.send(each)
            while asked is None:
                asked = motion.send(each)
            demands.append(asked)
    except StopIteration as end:
        return demands, end.value
    raise AssertionError("it did not end")


def test_a_demand_is_held_until_an_observation_fulfils_the_condition() -> None:
    seen = observations(torque_set_Nm=[0, 0, 1, 2, 3, 4] + [5] * 94)
    demands, end = carry_out(hold(Demand(brake=0.3), lambda one: one.torque_set_Nm >= 3), seen)
    assert demands == [Demand(brake=0.3)] * 4
    assert end == seen[4]


@pytest.mark.parametrize(("for_s", "looks"), [(0.0, 1), (0.05, 1), (0.3, 3), (0.31, 4)])
def test_a_wait_counts_from_the_observation_at_hand(for_s: float, looks: int) -> None:
    seen = observations()
    demands, end = carry_out(wait(Demand(), for_s), seen)
    assert len(demands) == looks
    assert end == seen[looks]


@pytest.mark.parametrize(("limit_s", "late"), [(0.19, True), (0.21, False)])
def test_a_motion_that_has_not_ended_when_the_time_is_over_fails(
    limit_s: float, late: bool
) -> None:
    motion = within(limit_s, wait(Demand(), 0.3), lambda seen: f"late at {seen.t_ns}")
    if late:
        with pytest.raises(MotionFailed, match="late at 1200000000"):
            carry_out(motion, observations())
    else:
        assert len(carry_out(motion, observations())[0]) == 3


def test_a_limit_may_count_from_before() -> None:
    first, *others = observations()
    motion = within(0.25, wait(Demand(), 0.3), lambda _: "late", since=first)
    with pytest.raises(MotionFailed, match="late"):
        carry_out(motion, others)


def test_a_fault_ends_a_motion_unless_it_has_ended_by_then() -> None:
    seen = observations(trip_bits=[0, 0, 0, 1] + [0] * 96)

    def fault(one):
        return "tripped" if one.trip_bits else ""

    with pytest.raises(MotionFailed, match="tripped"):
        carry_out(guarded(wait(Demand(), 0.5), fault), seen)
    assert carry_out(guarded(wait(Demand(), 0.3), fault), seen)[1] == seen[3]


def test_the_innermost_restartable_motion_begins_again() -> None:
    began = []

    @restartable
    def inner():
        began.append("inner")
        yield Demand(torque_Nm=1.0)
        return "result"

    @restartable
    def outer():
        began.append("outer")
        return (yield from inner())

    motion = outer()
    next(motion)
    assert motion.throw(Restarted()) == Demand(torque_Nm=1.0)
    with pytest.raises(StopIteration) as end:
        motion.send(observations(1)[0])
    assert end.value.value == "result"
    assert began == ["outer", "inner", "inner"]


def test_a_speed_counts_after_a_turn_and_within_its_tolerance() -> None:
    seen = observations(speed_rad_s=[2 * np.pi * 0.5] * 100)
    assert [near_speed(0.5, 0.02, seen[0])(one) for one in (seen[20], seen[21])] == [False, True]
    assert not near_speed(0.52, 0.02, seen[0])(seen[50])
    assert near_speed(0.509, 0.02, seen[0])(seen[50])


@pytest.mark.parametrize("direction", [1, -1])
def test_a_capture_ends_after_its_turns_either_way(direction: int) -> None:
    turns = np.arange(100) * 0.1 * direction
    seen = observations(angle_rad=2 * np.pi * turns % (2 * np.pi), plan_point=[-1] * 5 + [3] * 95)
    point = OperatingPoint(3, 1.0, 1.0, 2)
    demands, end = carry_out(capture(point, Demand(label="capturing")), seen)
    assert {demand.plan_point for demand in demands} == {3}
    assert abs(end.point_turns) == pytest.approx(2.0, abs=0.11)


def test_a_capture_in_which_the_rotor_stands_fails() -> None:
    point = OperatingPoint(0, 1.0, 1.0, 1)
    with pytest.raises(MotionFailed, match="the rotor stopped turning"):
        carry_out(capture(point, Demand()), observations())


COMMON = [
    "index", "torque_Nm", "speed_Hz", "tick_start", "tick_end", "t_start_ns", "t_end_ns", "turns",
    "speed_mean_Hz",
]  # fmt: skip


def test_the_account_of_a_capture_has_its_fields_in_one_order() -> None:
    point, seen = OperatingPoint(3, 1.0, 0.5, 2), observations(1)[0]
    assert list(account(point, seen, "ok")) == [*COMMON, "brake", "compensate", "quality"]
    assert list(account(point, seen, "ok", driven=True)) == [
        *COMMON, "driven", "compensate", "quality",
    ]  # fmt: skip
    swing = account(point, seen, "ok", turns=0.25, swing={"seconds": 1.0})
    assert list(swing) == [*COMMON, "brake", "compensate", "quality", "swing"]
    assert (swing["turns"], swing["torque_Nm"], swing["speed_Hz"]) == (0.25, 1.0, 0.5)


def test_what_a_motion_finds_is_a_value_for_the_next() -> None:
    def find():
        seen = yield from wait(Demand(enabled=True, label="finding"), 0.2)
        return seen.since_s(first) * 10

    def plan(points):
        torque_Nm = yield from find()
        yield from wait(Demand(torque_Nm=torque_Nm, induced=Induced(cogging=0.0)), 0.2)

    first, *others = observations(state=State.ENABLED)
    executor = Executor(Plan("values", (), plan, lambda point: 1.0, {}))
    demands = [executor.advance(seen) for seen in (first, *others)]
    assert [demand.torque_Nm for demand in demands[:5]] == pytest.approx([0, 0, 2, 2, 0])
    assert executor.state is PlanState.DONE
    assert demands[-1] == Demand()
