"""Whole turns and segments of steady speed in positions of any origin."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.identification import CaptureError, IdentifyError
from motord.identification.turning import (
    LostTurns,
    continuous_turns,
    countable,
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


def counted(t_s: np.ndarray, turns: np.ndarray, counts: int = 1000) -> np.ndarray:
    """Return the position of all samples, in turns, if they can be counted."""
    count = np.floor(turns * counts).astype(int) % counts
    assert countable(t_s, count, counts, "here")[0].all()
    return unwrap_counts(count, counts) / counts


@pytest.mark.parametrize("speed_Hz", [0.1, 6.0, -6.0])
@pytest.mark.parametrize(("gap", "lost"), [(0.45, False), (0.55, True), (1.0, True), (1.4, True)])
def test_turns_that_a_gap_may_hide_are_refused(speed_Hz: float, gap: float, lost: bool) -> None:
    """The shorter way round is right below half a turn."""
    t_s = np.arange(-4.0, 4.0, abs(speed_Hz) * 1e-3) / abs(speed_Hz)
    t_s = t_s[(t_s < 0) | (t_s > gap / abs(speed_Hz))]
    if lost:
        with pytest.raises(LostTurns, match=r"here: .* turns: they cannot be counted"):
            counted(t_s, speed_Hz * t_s)
    else:
        assert abs(np.ptp(counted(t_s, speed_Hz * t_s))) == pytest.approx(8, abs=0.01)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("slow", [0.01, 0.2])
def test_a_gap_counts_by_the_speed_on_either_side(slow: float, way: int) -> None:
    """A rotor that was slow before it, or is after it, may have made a turn in it."""
    steps = np.r_[np.full(500, slow), 0.9, np.full(500, 0.45)]
    t_s = np.cumsum(np.where(steps == 0.9, 2e-3, 1e-3))
    for order in (steps, steps[::-1]):
        with pytest.raises(LostTurns, match=r"0\.002 s .* about 0\.9 turns"):
            counted(t_s, way * np.cumsum(order))


def test_turns_that_few_lost_samples_hide_are_refused() -> None:
    """Three of 100 Hz at 15 Hz hide a turn, though a gap of the signals' shape is longer."""
    t_s = np.arange(1000) * 0.01
    kept = np.arange(1000) % 40 < 37
    with pytest.raises(LostTurns, match=r"0\.04 s .* about 0\.6 turns"):
        counted(t_s[kept], 15 * t_s[kept])


def test_other_gaps_nearby_hide_no_speed() -> None:
    """What is lost in them would make the rotor look slow."""
    t_s = np.arange(10000) * 0.001
    kept = np.arange(10000) % 10 < 4
    with pytest.raises(LostTurns, match=r"0\.007 s .* about 0\.63 turns"):
        counted(t_s[kept], 90 * t_s[kept])


@pytest.mark.parametrize("per_sample", [0.01, 0.125, 0.24])
def test_one_count_out_of_range_in_turns_that_can_be_counted_is_left_out(per_sample: float) -> None:
    """The next one to it may be misread, too: it is not how fast the rotor is."""
    t_s = np.arange(2000) * 1e-3
    count = np.floor(per_sample * np.arange(2000) * 4096).astype(int) % 4096
    count[1000] = 65535
    if per_sample < 0.1:
        count[1001] = (count[1001] + 1000) % 4096
    good, *_ = countable(t_s, count, 4096, "here")
    assert np.flatnonzero(~good).tolist() == [1000, 1001][: 1 + (per_sample < 0.1)]
    turned = np.ptp(unwrap_counts(count[good], 4096)) / 4096
    assert turned == pytest.approx(1999 * per_sample, abs=1e-3)


@pytest.mark.parametrize("direction", [1, -1])
def test_counts_out_of_range_in_which_a_turn_may_pass_are_refused(direction: int) -> None:
    """Turns were lost, and with them mean speed and power: 1.7 % of 60 turns."""
    count = np.arange(100_000)[::direction] * 8 % 4096
    short, long, t_s = count.copy(), count.copy(), np.arange(100_000) * 1e-3
    short[500:620] = long[500:1020] = 65535
    good, *_ = countable(t_s, short, 4096, "here")
    assert np.flatnonzero(~good).tolist() == list(range(500, 620))
    with pytest.raises(LostTurns, match=r"here: 0\.521 s .* about 1 turns"):
        countable(t_s, long, 4096, "here")


def test_a_misread_count_loses_no_turn() -> None:
    """By half a turn, that of the highest bit, the shorter way round took one back."""
    turns = np.arange(5000) * 0.01
    count = np.floor(turns * 4096).astype(int) % 4096
    count[[100, 2000, 2500, 4000]] ^= 2048
    good, *_ = countable(np.arange(5000) * 1e-3, count, 4096, "here")
    assert np.flatnonzero(~good).tolist() == [100, 2000, 2500, 4000]
    position = unwrap_counts(count, 4096)
    assert position[-1] - position[0] == pytest.approx(4999 * 0.01 * 4096, abs=1)
    assert np.abs(position - turns * 4096).max() < 2050


def test_times_that_come_in_bunches_are_no_gaps() -> None:
    """Ten samples at a time, as a USB adapter hands them over: within one nothing shows a speed."""
    number = np.arange(2000)
    counted(number // 10 * 0.01 + number % 10 * 1e-5, 20 * number * 0.001)


@pytest.mark.parametrize("seed", range(3))
def test_no_turn_is_lost_however_samples_are(seed: int) -> None:
    """Steady, slowing down and starting rotors, samples missing singly and in bunches."""
    rng, accepted = np.random.default_rng(seed), 0
    for _ in range(150):
        t_s = np.cumsum(1 + rng.choice([0, 0.4]) * rng.uniform(-1, 1, 1000)) * 1e-3
        turns = np.exp(rng.uniform(np.log(10), np.log(450))) * t_s
        turns = rng.choice([turns, turns * (1 - 0.4 * t_s), turns * t_s / 2])
        kept = rng.uniform(size=1000) > rng.choice([0, 0.005, 0.3])
        first = rng.integers(0, 1000, rng.integers(0, 4))
        for one in first:
            kept[one : one + rng.integers(1, 60)] = False
        try:
            found = counted(t_s[kept], turns[kept], 4096)
        except LostTurns:
            assert np.diff(turns[kept]).max() > 0.4
        else:
            accepted += 1
            assert np.abs(found - found[0] - turns[kept] + turns[kept][0]).max() < 0.01
    assert accepted > 40


@pytest.mark.parametrize("size", [0, 1, 2])
def test_few_samples_have_no_gap(size: int) -> None:
    counted(np.arange(size), np.zeros(size))


def test_an_angle_alone_will_do() -> None:
    position_rad = np.linspace(1.0, 20.0, 500)
    found, grid = unwrapped(record(100, position_rad)[["angle_rad"]], 100, "here")
    assert grid == 0
    assert found - found[0] == pytest.approx(position_rad - 1.0, abs=1e-5)


@pytest.mark.parametrize("stands", [0, 7])
def test_next_to_a_count_that_stands_an_angle_is_none_of_an_encoder(stands: int) -> None:
    """At 0 where no encoder answers."""
    ticks = record(100, np.linspace(1.0, 20.0, 500))
    ticks["encoder_count"] = stands
    with pytest.raises(CaptureError, match=f"here: encoder_count is {stands} from the first sampl"):
        unwrapped(ticks, 100, "here")


def test_a_missing_angle_is_reported() -> None:
    with pytest.raises(CaptureError, match="here: no encoder_count and no angle_rad that moves"):
        unwrapped(np.zeros(10, [("angle_rad", "f4")]), 100, "here")


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
    speed=st.floats(-0.47, 0.47),
    trembles=st.lists(st.floats(-0.02, 0.02), max_size=30),
    first=st.integers(0, 5000),
)
def test_counts_are_unwrapped_by_the_shorter_way(
    counts: int, speed: float, trembles: list[float], first: int
) -> None:
    moved = np.array([int((speed + tremble) * counts) for tremble in trembles], int)
    position = first % counts + np.concatenate([[0], np.cumsum(moved)])
    assert unwrap_counts(position % counts, counts).tolist() == position.tolist()
    assert unwrap_counts(position[:0], counts).size == 0


@given(st.integers(3, 5000), st.lists(st.integers(0, 5000), min_size=1, max_size=30))
def test_unwrapped_counts_differ_from_what_was_read_by_whole_turns(
    counts: int, read: list[int]
) -> None:
    count = np.array(read) % counts
    position = unwrap_counts(count, counts)
    assert position[0] == count[0]
    np.testing.assert_array_equal(position % counts, count)


def turns_of(
    count: np.ndarray, counts: int, *, from_start: bool = False
) -> tuple[tuple[int, int], ...]:
    return continuous_turns(unwrap_counts(count, counts), counts, "here", from_start=from_start)


@pytest.mark.parametrize("direction", [1, -1])
def test_turns_of_a_short_capture_count_from_its_first_sample(direction: int) -> None:
    count = (700 + direction * 5 * np.arange(650)) % 1000  # 5 counts a sample, 3.25 turns
    turns = turns_of(count, 1000, from_start=True)
    assert turns == ((0, 200), (200, 400), (400, 600))
    assert len(turns_of(count, 1000)) == 2
    # what comes next would begin the fourth turn: the third has all its samples
    assert turns_of(count[:600], 1000, from_start=True) == turns
    assert len(turns_of(count[:599], 1000, from_start=True)) == 2


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
    found = turns_of(count, counts, from_start=True)
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
    found = turns_of(count, counts)
    assert len(found) == turns - 1
    assert all(min(count[first], counts - count[first]) <= 1 for first, _ in found)
    assert found == turns_of(count, counts, from_start=False)


def test_less_than_a_turn_from_the_start_is_refused() -> None:
    with pytest.raises(IdentifyError, match="here"):
        turns_of(np.arange(70, 165) % 100, 100, from_start=True)
    with pytest.raises(IdentifyError, match="here"):
        turns_of(np.zeros(0, int), 100, from_start=True)
