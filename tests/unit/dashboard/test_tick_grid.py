"""Where ticks are on the grid."""

import numpy as np
import pytest

from motord.dashboard.history import ANCHOR_S, TickGrid
from tests.unit.dashboard.ticks import block

S = 1_000_000_000


def slots(grid, ticks):
    return [(run.slot, len(run.ticks)) for run in grid.runs(ticks)]


def test_ticks_on_end_are_one_run_after_another():
    grid = TickGrid(1000.0, epoch_ns=0)
    assert slots(grid, block(100)) == [(0, 100)]
    assert slots(grid, block(50, first=100)) == [(100, 50)]


def test_the_epoch_is_at_slot_0():
    grid = TickGrid(1000.0, epoch_ns=5 * S)
    assert slots(grid, block(10, t0_ns=7 * S, first=400)) == [(2400, 10)]


def test_jitter_of_the_samples_moves_no_tick():
    grid = TickGrid(1000.0, epoch_ns=0)
    ticks = block(1000)
    ticks["t_ns"] += np.random.default_rng(1).integers(-9_000_000, 9_000_000, 1000)
    assert slots(grid, ticks[:500]) + slots(grid, ticks[500:]) == [(0, 500), (500, 500)]


@pytest.mark.parametrize("rate_Hz", [333, 3000, 15_000])
def test_periods_of_whole_nanoseconds_are_no_gap_after_a_week(rate_Hz):
    period_ns = round(1e9 / rate_Hz)
    grid, week = TickGrid(rate_Hz, epoch_ns=0), 7 * 86_400 * rate_Hz
    ticks = block(100)
    ticks["t_ns"] = ticks["tick"] * period_ns
    assert slots(grid, ticks) == [(0, 100)]
    ticks["tick"] += week
    ticks["t_ns"] += week * period_ns
    assert slots(grid, ticks) == [(week, 100)]


def test_a_gap_between_blocks_is_one_between_runs():
    grid = TickGrid(1000.0, epoch_ns=0)
    slots(grid, block(100))
    assert slots(grid, block(100, first=110)) == [(110, 100)]


def test_a_gap_in_a_block_ends_a_run():
    grid = TickGrid(1000.0, epoch_ns=0)
    ticks = np.delete(block(100), [40, 41])
    assert slots(grid, ticks) == [(0, 40), (42, 58)]


@pytest.mark.parametrize("pause_s", [0.0, 0.5, 3600.0])
def test_after_a_restart_the_counter_begins_anew_where_the_time_is(pause_s):
    grid = TickGrid(1000.0, epoch_ns=0)
    slots(grid, block(1000, missed=7))
    later = block(100, t0_ns=round((1 + pause_s) * S))
    assert slots(grid, later) == [(1000 + round(pause_s * 1000), 100)]


def test_a_restart_in_one_block_is_seen():
    grid = TickGrid(1000.0, epoch_ns=0)
    both = np.concatenate([block(100), block(50, t0_ns=2 * S)])
    assert slots(grid, both) == [(0, 100), (2000, 50)]


def test_time_never_goes_back():
    grid = TickGrid(1000.0, epoch_ns=0)
    slots(grid, block(1000))
    assert slots(grid, block(10, t0_ns=0)) == [(1000, 10)]


@pytest.mark.parametrize(("off_s", "anew"), [(0.9 * ANCHOR_S, False), (1.1 * ANCHOR_S, True)])
def test_ticks_far_from_their_counter_begin_anew(off_s, anew):
    grid = TickGrid(1000.0, epoch_ns=0)
    slots(grid, block(100))
    ticks = block(10, first=100, t0_ns=round(off_s * S))
    assert slots(grid, ticks) == [(100 + round(off_s * 1000) * anew, 10)]
