"""Histograms of the last minute."""

import numpy as np
import pytest

from motord.dashboard.timing import SECONDS, EDGES_us, TimingHistograms
from tests.unit.dashboard.ticks import block

S = 1_000_000_000


def place(us):
    return int(np.searchsorted(EDGES_us, us, side="right")) - 1


def test_ticks_are_counted_where_they_belong():
    timing = TimingHistograms()
    timing.add(block(10, wake_late_ns=2_000, work_ns=30_000))
    timing.add(block(5, first=10, wake_late_ns=400_000, work_ns=30_000))
    wake, work = timing.counts()
    assert (wake[place(2.0)], wake[place(400.0)], wake.sum()) == (10, 5, 15)
    assert (work[place(30.0)], work.sum()) == (15, 15)


@pytest.mark.parametrize(("late_ns", "at"), [(-50, 0), (0, 0), (2_000_000_000, -1)])
def test_what_is_outside_counts_in_the_first_or_last_bin(late_ns, at):
    timing = TimingHistograms()
    timing.add(block(3, wake_late_ns=late_ns))
    assert timing.counts()[0][at] == 3


def test_a_minute_later_it_is_forgotten():
    timing = TimingHistograms()
    for second in range(2 * SECONDS):
        timing.add(block(1, t0_ns=1_700_000_000 * S + second * S))
    assert timing.counts()[0].sum() == SECONDS


@pytest.mark.parametrize(("pause_s", "left"), [(1, 8), (SECONDS - 1, 8), (SECONDS, 1), (1e6, 1)])
def test_a_pause_is_no_reason_to_remember(pause_s, left):
    timing = TimingHistograms()
    timing.add(block(7, t0_ns=1_700_000_000 * S))
    timing.add(block(1, t0_ns=round((1_700_000_000 + pause_s) * S)))
    assert timing.counts()[0].sum() == left


def test_after_the_clock_was_set_back_it_begins_anew():
    timing = TimingHistograms()
    timing.add(block(8, t0_ns=1_700_000_000 * S))
    timing.add(block(3, t0_ns=1_600_000_000 * S))
    timing.add(block(2, t0_ns=(1_600_000_000 + SECONDS - 1) * S))
    assert timing.counts()[0].sum() == 5
    timing.add(block(1, t0_ns=(1_600_000_000 + SECONDS) * S))
    assert timing.counts()[0].sum() == 3
