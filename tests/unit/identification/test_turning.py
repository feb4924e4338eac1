"""Whole turns and segments of steady speed in positions of any origin."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.identification import IdentifyError
from motord.identification.turning import (
    UNSEEN_TURN,
    continuous_turns,
    require_every_turn,
    segments,
    steady_segments,
    unwrap_counts,
    unwrapped,
    whole_turns,
)

TURN = 2 * np.pi


def record(counts: int, position_rad: np.ndarray) -> np.ndarray:
    ticks = np.zeros(position_rad.size, [("encoder_count", "i4"), ("angle_rad", "f4")])
    ticks["encoder_count"] = np.rint(position_rad / TURN * counts).astype(int) % counts
    ticks["angle_rad"] = position_rad % TURN
    return ticks


@given(
    counts=st.integers(16, 20_000),
    start=st.floats(0, TURN),
    turns=st.floats(1.2, 9),
    direction=st.sampled_from([1, -1]),
)
def test_counts_run_on_over_turns(counts: int, start: float, turns: float, direction: int) -> None:
    position_rad = start + direction * np.linspace(0, turns * TURN, 1500)
    found, grid = unwrapped(record(counts, position_rad), counts, "here")
    off = found - position_rad
    assert grid == counts
    assert np.abs(off - TURN * np.rint(off / TURN)).max() <= np.pi / counts + 1e-9
    assert np.ptp(off) < TURN / counts + 1e-9
    whole = whole_turns(found)
    assert len(whole) >= int(turns - 1 / counts) - 1
    assert {turn.direction for turn in whole} <= {direction}


@pytest.mark.parametrize("speed_Hz", [0.1, 6.0, -6.0])
@pytest.mark.parametrize(("share", "refused"), [(0.9, False), (1.1, True), (2.6, True)])
def test_turns_that_a_gap_may_hide_are_refused(
    speed_Hz: float, share: float, refused: bool
) -> None:
    """Part of UNSEEN_TURN that passes in the gap; the shorter way round is right below half."""
    turns = np.arange(-4.0, 4.0, abs(speed_Hz) * 1e-3)
    kept = (turns < 0) | (turns > share * UNSEEN_TURN)
    t_s, count = turns[kept] / speed_Hz, np.floor(turns[kept] * 1000).astype(int) % 1000
    t_s, count = (t_s, count) if speed_Hz > 0 else (t_s[::-1], count[::-1])
    position = unwrap_counts(count, 1000)
    if refused:
        with pytest.raises(IdentifyError, match=r"here: .* turns: they cannot be counted"):
            require_every_turn(t_s, position, 1000, "here")
    else:
        require_every_turn(t_s, position, 1000, "here")
        assert abs(np.ptp(position)) == pytest.approx(8000, abs=10)


def test_turns_that_few_lost_samples_hide_are_refused() -> None:
    """Three of 100 Hz at 15 Hz hide a turn, though a gap of the signals' shape is longer."""
    t_s = np.arange(1000) * 0.01
    kept = np.arange(1000) % 40 < 37
    position = unwrap_counts(np.floor(15 * t_s[kept] * 1000).astype(int) % 1000, 1000)
    assert np.ptp(position) < 0.9 * 15 * 10 * 1000
    with pytest.raises(IdentifyError, match=r"0\.04 s .* about 0\.6 turns"):
        require_every_turn(t_s[kept], position, 1000, "here")


def test_other_gaps_nearby_hide_no_speed() -> None:
    """What is lost in them would make the rotor look slow."""
    t_s = np.arange(10000) * 0.001
    kept = np.arange(10000) % 10 < 6
    position = unwrap_counts(np.floor(90 * t_s[kept] * 1000).astype(int) % 1000, 1000)
    with pytest.raises(IdentifyError, match=r"0\.005 s .* about 0\.45 turns"):
        require_every_turn(t_s[kept], position, 1000, "here")


def test_times_that_come_in_bunches_are_no_gaps() -> None:
    """Ten samples at a time, as a USB adapter hands them over: within one nothing shows a speed."""
    number = np.arange(2000)
    t_s = number // 10 * 0.01 + number % 10 * 1e-5
    position = np.floor(20 * number * 0.001 * 1000).astype(int)
    require_every_turn(t_s, position, 1000, "here")


@pytest.mark.parametrize("size", [0, 1, 2])
def test_few_samples_have_no_gap(size: int) -> None:
    require_every_turn(np.arange(size), np.zeros(size), 1000, "here")


def test_an_angle_alone_will_do() -> None:
    position_rad = np.linspace(1.0, 20.0, 500)
    ticks = record(100, position_rad)
    ticks["encoder_count"] = 0
    for columns in (["encoder_count", "angle_rad"], ["angle_rad"]):
        found, grid = unwrapped(ticks[columns], 100, "here")
        assert grid == 0
        assert found - found[0] == pytest.approx(position_rad - 1.0, abs=1e-5)


def test_a_missing_angle_is_reported() -> None:
    with pytest.raises(IdentifyError, match="here: no encoder_count and no angle_rad that moves"):
        unwrapped(np.zeros(10, [("encoder_count", "i4"), ("angle_rad", "f4")]), 100, "here")


def test_turns_go_from_zero_point_to_zero_point() -> None:
    position_rad = np.linspace(0.3 * TURN, 4.6 * TURN, 4301)
    turns = whole_turns(position_rad)
    assert len(turns) == 3
    for turn in turns:
        assert position_rad[turn.first] / TURN % 1 == pytest.approx(0, abs=2e-3)
        assert 999 <= turn.end - turn.first <= 1001


def test_turns_that_hardly_meet_the_zero_point_count_from_the_start() -> None:
    position_rad = np.linspace(0.5 * TURN, 2.55 * TURN, 2051)
    for turns in (whole_turns(position_rad), whole_turns(-position_rad)):
        assert [turn.end - turn.first for turn in turns] == [1000, 1000]


def test_a_rotor_that_trembles_on_the_zero_point_makes_no_turns() -> None:
    trembling = 0.01 * np.sin(np.arange(3000) / 20)
    turning = np.linspace(0, 3.2 * TURN, 3200)
    position_rad = np.concatenate([trembling, turning])
    turns = whole_turns(position_rad)
    assert len(turns) == 3
    assert all(900 < turn.end - turn.first < 1100 for turn in turns)


def test_a_slow_start_is_left_out() -> None:
    t_s = np.arange(20_000) * 1e-3
    speed_Hz = np.minimum(t_s / 5, 1.0)
    position_rad = TURN * np.cumsum(speed_Hz) * 1e-3
    [turns], dropped = segments(t_s, whole_turns(position_rad))
    assert {reason for _, reason in dropped} == {"at another speed"}
    assert 13 <= len(turns) <= 17
    durations = [t_s[turn.end] - t_s[turn.first] for turn in turns]
    assert max(durations) / min(durations) < 1.2


def test_each_speed_and_each_direction_is_a_stretch() -> None:
    speeds = np.repeat([0.5, 1.0, 1.5, -1.0], [8000, 6000, 4000, 5000])
    t_s = np.arange(speeds.size) * 1e-3
    groups = steady_segments(t_s, whole_turns(TURN * np.cumsum(speeds) * 1e-3))
    long = [group for group in groups if len(group) >= 3]
    assert [group[0].direction for group in long] == [1, 1, 1, -1]
    assert [len(group) for group in long] == [3, 6, 6, 5]  # the first zero is passed after a turn


def test_turns_that_are_all_different_are_one_segment_of_each_direction() -> None:
    speeds = np.concatenate([np.linspace(0.2, 2, 4000), -np.linspace(0.2, 1, 2500)])
    t_s = np.arange(speeds.size) * 1e-3
    turns = whole_turns(TURN * np.cumsum(speeds) * 1e-3)
    [forwards], dropped = segments(t_s, turns)
    assert {turn.direction for turn in forwards} == {1}
    assert len(forwards) >= 3
    assert {reason for _, reason in dropped} == {"few turns of this direction"}
    twice = np.concatenate([speeds, -speeds])
    turns = whole_turns(TURN * np.cumsum(twice) * 1e-3)
    both, dropped = segments(np.arange(twice.size) * 1e-3, turns)
    assert [one[0].direction for one in both] == [1, -1]
    assert not dropped


def test_no_turns_are_no_segments() -> None:
    assert segments(np.zeros(0), []) == ([], [])


@given(
    counts=st.integers(3, 5000),
    steps=st.lists(st.floats(-0.49, 0.49), max_size=30),
    first=st.integers(0, 5000),
)
def test_counts_are_unwrapped_by_the_shorter_way(
    counts: int, steps: list[float], first: int
) -> None:
    moved = np.array([int(step * counts) for step in steps], int)
    position = first % counts + np.concatenate([[0], np.cumsum(moved)])
    assert unwrap_counts(position % counts, counts).tolist() == position.tolist()
    assert unwrap_counts(position[:0], counts).size == 0


@pytest.mark.parametrize("direction", [1, -1])
def test_turns_of_a_short_capture_count_from_its_first_sample(direction: int) -> None:
    count = (700 + direction * 5 * np.arange(650)) % 1000  # 5 counts a sample, 3.25 turns
    turns = continuous_turns(count, 1000, "here", from_start=True)
    assert turns == ((0, 200), (200, 400), (400, 600))
    assert len(continuous_turns(count, 1000, "here")) == 2
    # what comes next would begin the fourth turn: the third has all its samples
    assert continuous_turns(count[:600], 1000, "here", from_start=True) == turns
    assert len(continuous_turns(count[:599], 1000, "here", from_start=True)) == 2


@given(
    counts=st.integers(40, 5000),
    start=st.floats(0, 1, exclude_max=True),
    turns=st.integers(1, 6),
    more=st.floats(0.05, 0.9),
    direction=st.sampled_from([1, -1]),
    trembling=st.booleans(),
)
def test_turns_from_the_start_lose_no_part_of_a_turn(
    counts: int, start: float, turns: int, more: float, direction: int, trembling: bool
) -> None:
    per_turn = 3 * counts
    steps = int((turns + more) * per_turn) + 3
    position = start * counts + direction * np.arange(steps) / 3
    if trembling:
        position += 0.7 * np.sin(np.arange(steps))
    count = np.rint(position).astype(int) % counts
    found = continuous_turns(count, counts, "here", from_start=True)
    assert len(found) == turns
    assert found[0][0] == 0
    assert all(end == first for (_, end), (first, _) in pairwise(found))
    assert all(abs(end - first - per_turn) <= 9 for first, end in found)


@given(
    counts=st.integers(16, 5000),
    start=st.floats(0.2, 0.8),
    turns=st.integers(2, 6),
    direction=st.sampled_from([1, -1]),
)
def test_turns_go_from_zero_point_to_zero_point_unless_asked_otherwise(
    counts: int, start: float, turns: int, direction: int
) -> None:
    position = start * counts + direction * np.arange(3 * turns * counts + 3) / 3
    count = np.rint(position).astype(int) % counts
    found = continuous_turns(count, counts, "here")
    assert len(found) == turns - 1
    assert all(min(count[first], counts - count[first]) <= 1 for first, _ in found)
    assert found == continuous_turns(count, counts, "here", from_start=False)


def test_less_than_a_turn_from_the_start_is_refused() -> None:
    with pytest.raises(IdentifyError, match="here"):
        continuous_turns(np.arange(70, 165) % 100, 100, "here", from_start=True)
    with pytest.raises(IdentifyError, match="here"):
        continuous_turns(np.zeros(0, int), 100, "here", from_start=True)
