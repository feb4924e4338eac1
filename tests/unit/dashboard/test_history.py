"""The pyramid against brute force: what is in a bucket, and that nothing is missing in it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.dashboard.history import FACTOR, RETENTION_S, History

RATE_HZ = 100.0
SHORT_S = (4.0, 40.0, 400.0)
"""Levels of 400, 4,000 and 40,000 slots, or a few more: laps come soon."""

values = st.lists(st.floats(-1e3, 1e3, width=32) | st.just(float("nan")), min_size=1, max_size=120)
blocks = st.lists(
    st.tuples(st.sampled_from([0, 0, 0, 1, 7, 250, 3_000, 100_000]), values, st.integers(1, 8)),
    min_size=1,
    max_size=12,
)


def filled(history, written):
    """Append blocks of (gap, values, times); return the values by slot."""
    slot, by_slot = 0, {}
    for gap, block, times in written:
        slot += gap
        for _ in range(times):
            row = np.array(block, np.float32)
            history.append(slot, np.stack([row, -row]))
            by_slot.update(zip(range(slot, slot + len(row)), row.tolist(), strict=True))
            slot += len(row)
    return by_slot


def brute_force(by_slot, begin, end, oldest):
    there = [by_slot.get(slot, np.nan) for slot in range(max(begin, oldest), end)]
    there = [value for value in there if not np.isnan(value)]
    return (min(there), max(there)) if there else (np.nan, np.nan)


@settings(max_examples=60, deadline=None)
@given(blocks, st.floats(0.0, 450.0), st.floats(0.02, 450.0), st.integers(1, 60))
def test_a_window_has_the_minimum_and_maximum_of_each_bucket(written, back_s, span_s, buckets):
    history = History(2, RATE_HZ, SHORT_S)
    by_slot = filled(history, written)
    t0_s = history.end / RATE_HZ - back_s - span_s
    grid = history.grid(span_s, buckets, t0_s)
    first = int(t0_s * RATE_HZ // grid.slots)
    window = history.window(grid, range(first, first + buckets), [1, 0])
    level = history._levels[grid.level]
    for bucket in range(buckets):
        begin = (first + bucket) * grid.slots
        low, high = brute_force(by_slot, begin, begin + grid.slots, level.oldest * level.slots)
        np.testing.assert_equal(window.low[1, bucket], np.float32(low))
        np.testing.assert_equal(window.high[1, bucket], np.float32(high))
        np.testing.assert_equal(window.low[0, bucket], np.float32(-high))
    assert window.t0_s == pytest.approx(first * grid.slots / RATE_HZ)


FULL_RATE_HZ, HOUR_S = 10_000, 3600
SPIKE_OF_AGE_S = {1e-3: 7.0, 30.0: 8.0, 500.0: 9.0, 3000.0: 10.0}


@pytest.fixture(scope="module")
def spiky():
    """An hour at 10 kHz with spikes of one tick."""
    history = History(1, FULL_RATE_HZ)
    spikes = {round((HOUR_S - age) * FULL_RATE_HZ): v for age, v in SPIKE_OF_AGE_S.items()}
    length = 30 * FULL_RATE_HZ
    for begin in range(0, HOUR_S * FULL_RATE_HZ, length):
        row = np.zeros((1, length), np.float32)
        for slot, value in spikes.items():
            if begin <= slot < begin + length:
                row[0, slot - begin] = value
        history.append(begin, row)
    return history


@pytest.mark.parametrize("span_s", [0.01, 0.3, 2.0, 60.0, 600.0, 3500.0])
@pytest.mark.parametrize("age_s", SPIKE_OF_AGE_S)
def test_a_spike_of_one_tick_shows_at_any_zoom(spiky, age_s, span_s):
    t0_s = max(0.0, HOUR_S - age_s - span_s / 2)
    grid = spiky.grid(span_s, 1000, t0_s)
    first = int(t0_s * FULL_RATE_HZ // grid.slots)
    window = spiky.window(grid, range(first, first + 1001), [0])
    assert np.count_nonzero(window.high == SPIKE_OF_AGE_S[age_s]) == 1
    assert np.nanmax(window.low) == (SPIKE_OF_AGE_S[age_s] if grid.slots == 1 else 0.0)


@pytest.mark.parametrize("span_s", [0.1, 1.0, 3.0, 39.0, 390.0])
@pytest.mark.parametrize("buckets", [1, 10, 77, 300])
def test_buckets_are_as_wide_as_asked_for_within_a_quarter(span_s, buckets):
    history = History(1, RATE_HZ, SHORT_S)
    history.append(0, np.zeros((1, 200), np.float32))
    grid = history.grid(span_s, buckets)
    asked_s = span_s / buckets
    assert asked_s * RATE_HZ - 1e-6 <= grid.slots
    assert grid.slots <= max(1, 1.25 * asked_s * RATE_HZ + 1)


def test_each_level_goes_back_as_far_as_it_says():
    history = History(1, 1000)
    for level, seconds in zip(history._levels, RETENTION_S, strict=True):
        assert level._capacity * level.slots >= seconds * 1000
        assert level._capacity % FACTOR == 0


def test_memory_is_bounded():
    """A signal at 10 kHz; all of it is there from the start."""
    history = History(1, 10_000)
    arrays = {id(a): a.nbytes for level in history._levels for a in (level._low, level._high)}
    assert sum(arrays.values()) < 6.9e6


def test_what_is_too_old_for_fine_cells_is_shown_by_coarser_ones():
    history = History(1, RATE_HZ, SHORT_S)
    for slot in range(0, 4000, 100):
        history.append(slot, np.full((1, 100), slot, np.float32))
    grid = history.grid(0.1, 10, t0_s=10.0)
    assert grid.slots == FACTOR
    window = history.window(grid, range(1000 // FACTOR, 1000 // FACTOR + 1), [0])
    assert (window.low[0, 0], window.high[0, 0]) == (900.0, 1000.0)
