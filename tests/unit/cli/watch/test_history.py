"""Minimum and maximum of every tick over the last minute."""

import numpy as np
import pytest

from motord.cli.bench.watch.feed import BUCKET_NS, SPAN_S, MinMaxHistory, column_of
from tests.unit.cli.watch.samples import NOW_NS, ticks

TORQUE, SPEED = 0, 1
COLUMNS = 80


def filled(*blocks):
    history = MinMaxHistory()
    for block in blocks:
        history.add(block)
    return history


def test_a_spike_of_one_tick_shows_in_one_column_of_a_minute():
    block = ticks(SPAN_S, torque_Nm=1.0)
    block["torque_Nm"][12345] = 9.0
    low, high = filled(*np.array_split(block, 7)).columns(NOW_NS, COLUMNS)
    assert np.count_nonzero(high[TORQUE] == 9.0) == 1
    assert np.nanmin(low[TORQUE]) == np.nanmin(high[TORQUE]) == 1.0
    assert np.flatnonzero(high[TORQUE] == 9.0) == column_of(
        int(block["t_ns"][12345]), NOW_NS, COLUMNS
    )


def test_a_spike_stays_in_its_place_relative_to_its_neighbours_as_time_goes_on():
    block = ticks(30.0, torque_Nm=1.0)
    block["torque_Nm"][5000] = 9.0
    history = filled(block)
    before = history.columns(NOW_NS, COLUMNS)[1][TORQUE]
    width_ns = 8 * BUCKET_NS
    after = history.columns(NOW_NS + 3 * width_ns, COLUMNS)[1][TORQUE]
    assert np.array_equal(before[3:], after[:-3], equal_nan=True)


def test_where_no_tick_was_there_is_no_value():
    low, high = filled(ticks(5.0, from_ns=NOW_NS - 20_000_000_000)).columns(NOW_NS, COLUMNS)
    assert np.isnan(high[TORQUE][-20:]).all()
    assert np.isfinite(high[TORQUE]).sum() in (7, 8)
    assert np.array_equal(np.isnan(low), np.isnan(high))


def test_what_is_older_than_a_minute_is_forgotten():
    history = filled(ticks(1.0, torque_Nm=9.0), ticks(1.0, 1.0, from_ns=NOW_NS + 90_000_000_000))
    assert np.nanmax(history.columns(NOW_NS + 90_000_000_000, COLUMNS)[1][TORQUE]) == 1.0


def test_ticks_of_the_past_are_added_where_they_belong_or_left_out():
    history = filled(
        ticks(1.0, 1.0),
        ticks(0.01, 5.0, from_ns=NOW_NS - 30_000_000_000),
        ticks(1.0, 9.0, from_ns=1),
    )
    high = history.columns(NOW_NS, COLUMNS)[1][TORQUE]
    assert np.nanmax(high) == 5.0
    assert len(np.flatnonzero(np.isfinite(high))) <= 4


def test_values_that_are_no_numbers_do_not_hide_others():
    block = ticks(1.0, 2.0)
    block["torque_Nm"][::2] = np.nan
    assert np.nanmax(filled(block).columns(NOW_NS, COLUMNS)[1][TORQUE]) == 2.0


def test_speed_is_in_turns_per_second():
    block = ticks(0.5)
    block["speed_rad_s"] = 2.0 * np.pi
    assert np.nanmax(filled(block).columns(NOW_NS, COLUMNS)[1][SPEED]) == pytest.approx(1.0)


@pytest.mark.parametrize("columns", [1, 7, 30, 80, 599, 600, 5000])
def test_at_most_as_many_columns_as_asked_for_make_up_the_minute(columns):
    low, _ = filled(ticks(1.0)).columns(NOW_NS, columns)
    assert low.shape[1] <= columns
    assert np.isfinite(low[TORQUE][-1])


def test_without_ticks_there_is_nothing():
    assert np.isnan(filled(ticks(0.0)).columns(NOW_NS, 10)[0]).all()
    assert column_of(NOW_NS - 61_000_000_000, NOW_NS, 10) is None
    assert column_of(NOW_NS + 61_000_000_000, NOW_NS, 10) is None
