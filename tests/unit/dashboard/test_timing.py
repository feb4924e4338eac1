"""Histograms of the last minute."""

import numpy as np
import pytest

from motord.dashboard.timing import SECONDS, EDGES_us, TimingHistograms
from tests.unit.dashboard.ticks import block


def place(us):
    return int(np.searchsorted(EDGES_us, us, side="right")) - 1


def test_ticks_are_counted_where_they_belong():
    timing = TimingHistograms()
    timing.add(block(10, wake_late_ns=2_000, work_ns=30_000), 0.0)
    timing.add(block(5, first=10, wake_late_ns=400_000, work_ns=30_000), 0.0)
    wake, work = timing.counts()
    assert (wake[place(2.0)], wake[place(400.0)], wake.sum()) == (10, 5, 15)
    assert (work[place(30.0)], work.sum()) == (15, 15)


@pytest.mark.parametrize(("late_ns", "at"), [(-50, 0), (0, 0), (2_000_000_000, -1)])
def test_what_is_outside_counts_in_the_first_or_last_bin(late_ns, at):
    timing = TimingHistograms()
    timing.add(block(3, wake_late_ns=late_ns), 0.0)
    assert timing.counts()[0][at] == 3


def test_a_minute_later_it_is_forgotten_whatever_time_the_samples_have():
    timing = TimingHistograms()
    for second in range(2 * SECONDS):
        timing.add(block(1), 1000.5 + second)
    assert timing.counts()[0].sum() == SECONDS


@pytest.mark.parametrize(("pause_s", "left"), [(1, 8), (SECONDS - 1, 8), (SECONDS, 1), (1e6, 1)])
def test_a_pause_is_no_reason_to_remember(pause_s, left):
    timing = TimingHistograms()
    timing.add(block(7), 1000.0)
    timing.add(block(1), 1000.0 + pause_s)
    assert timing.counts()[0].sum() == left
