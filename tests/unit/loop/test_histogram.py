"""The time histogram against numpy's quantiles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.shm.histogram import BINS, EDGES_ns, TimeHistogram
from motord.shm.time_count import count_time


def test_bins_have_no_gap_and_are_fine() -> None:
    widths = np.diff(EDGES_ns)
    assert EDGES_ns[0] == 0
    assert EDGES_ns[-1] == 2**31
    assert (widths > 0).all()
    assert (widths[64:] / EDGES_ns[64:-1]).max() <= 1 / 32


@pytest.mark.kernel
@given(st.integers(0, 2**31 - 1))
def test_every_time_falls_into_its_bin(time_ns: int) -> None:
    histogram = TimeHistogram()
    count_time(histogram.cells, time_ns)
    (index,) = np.flatnonzero(histogram.counts)
    assert EDGES_ns[index] <= time_ns < EDGES_ns[index + 1]
    assert histogram.max_ns == time_ns


@pytest.mark.parametrize(("time_ns", "index"), [(-5, 0), (2**31, BINS - 1), (2**40, BINS - 1)])
def test_times_out_of_range_are_counted_at_the_ends(time_ns: int, index: int) -> None:
    histogram = TimeHistogram()
    count_time(histogram.cells, time_ns)
    assert histogram.counts[index] == 1


@given(st.lists(st.integers(0, 10**8), min_size=1, max_size=200), st.floats(0, 1))
def test_quantile_is_within_a_bin_of_the_true_one(times_ns: list[int], fraction: float) -> None:
    histogram = TimeHistogram()
    for time_ns in times_ns:
        count_time(histogram.cells, time_ns)
    true_ns = float(np.quantile(times_ns, fraction, method="inverted_cdf"))
    got_ns = histogram.quantile_ns(fraction)
    assert true_ns * (1 - 1 / 31) - 1 <= got_ns <= true_ns * (1 + 1 / 31) + 1
    assert got_ns <= max(times_ns)


def test_summary_holds_everything() -> None:
    histogram = TimeHistogram()
    for time_ns in [1000] * 98 + [50_000, 2_000_000]:
        count_time(histogram.cells, time_ns)
    summary = histogram.summary()
    assert summary.samples == sum(count for _, count in summary.bins) == 100
    assert summary.p50_us == pytest.approx(1.0, rel=0.04)
    assert summary.p99_us == pytest.approx(50.0, rel=0.04)
    assert summary.max_us == 2000.0
    assert len(summary.bins) == 3


def test_summary_of_nothing() -> None:
    assert TimeHistogram().summary().samples == 0
    assert np.isnan(TimeHistogram().quantile_ns(0.5))
