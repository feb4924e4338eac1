"""The loop's histograms in shared memory, and what a part of a run adds to them."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.shm.shared_records import SharedFileError
from motord.shm.time_count import count_time
from motord.shm.timing import BoardClockError, Timing, TimingPart, total

TIMES = st.lists(st.integers(0, 10**7), max_size=50)


def test_others_see_what_the_loop_counts(tmp_path: Path) -> None:
    path = tmp_path / "timing"
    own = Timing.create(path)
    seen = Timing.attach(path)
    before = seen.copy()
    count_time(own.wake_late.cells, 1_000)
    count_time(own.work.cells, 20_000)
    own.record["missed"] = 3
    assert seen.summary() == own.summary()
    assert (seen.missed, seen.wake_late.max_ns) == (3, 1_000)
    assert before.summary().work.samples == 0
    with pytest.raises(SharedFileError, match="cannot open"):
        Timing.attach(tmp_path / "none")


def test_others_see_the_bridges_clock(tmp_path: Path) -> None:
    own = Timing.create(tmp_path / "timing")
    seen = Timing.attach(tmp_path / "timing")
    assert seen.clock == BoardClockError(0.0, 0.0)
    own.set_board_clock(-35.25, 12_500)
    assert seen.clock == BoardClockError(-35.25, 12.5)
    assert seen.copy().clock == seen.clock


@given(TIMES, TIMES)
def test_a_part_of_a_run_is_the_difference(before_ns: list[int], after_ns: list[int]) -> None:
    timing, only = Timing(), Timing()
    for time_ns in before_ns:
        count_time(timing.work.cells, time_ns)
    earlier = timing.copy()
    for time_ns in after_ns:
        count_time(timing.work.cells, time_ns)
        count_time(only.work.cells, time_ns)
    part = timing.since(earlier)
    assert np.array_equal(part.work.counts, only.work.counts)
    assert only.work.max_ns <= part.work.max_ns <= max(only.work.max_ns * 33 // 32 + 1, 0)
    earlier.merge(part)
    assert np.array_equal(earlier.work.counts, timing.work.counts)
    assert earlier.work.max_ns <= timing.work.max_ns * 33 // 32 + 1


def test_missed_periods_are_counted_for_the_part_too() -> None:
    timing = Timing()
    timing.record["missed"] = 5
    earlier = timing.copy()
    timing.record["missed"] = 7
    assert timing.since(earlier).summary().missed == 2
    earlier.merge(timing.since(earlier))
    assert earlier.missed == 7


def test_part_of_a_run_that_ends_with_its_loop(tmp_path: Path) -> None:
    loop = Timing.create(tmp_path / "timing")
    count_time(loop.work.cells, 5_000)
    part = TimingPart(tmp_path / "timing")
    count_time(loop.work.cells, 7_000)
    loop.record["missed"] = 2
    del loop
    count_time(Timing.create(tmp_path / "timing").work.cells, 9_000)
    summary = part.summary()
    assert (summary.work.samples, summary.missed) == (1, 2)
    assert 7.0 <= summary.work.max_us < 7.3


@given(st.lists(TIMES, max_size=4))
def test_the_parts_of_a_run_add_up_to_all_of_it(parts_ns: list[list[int]]) -> None:
    whole, summaries = Timing(), []
    for times_ns in parts_ns:
        part = Timing()
        part.record["missed"] = len(times_ns)
        whole.record["missed"] += len(times_ns)
        for time_ns in times_ns:
            for timing in (whole, part):
                count_time(timing.wake_late.cells, time_ns)
                count_time(timing.work.cells, time_ns // 2)
        summaries.append(part.summary())
    assert total(summaries) == whole.summary()


def test_parts_are_taken_one_after_the_other(tmp_path: Path) -> None:
    loop = Timing.create(tmp_path / "timing")
    part = TimingPart(tmp_path / "timing")
    for count in (2, 0, 1):
        for _ in range(count):
            count_time(loop.wake_late.cells, 100)
        loop.record["missed"] += count
        taken = part.take()
        assert (taken.wake_late.samples, taken.missed) == (count, count)
    assert "3 missed of 6" in loop.summary().line()
