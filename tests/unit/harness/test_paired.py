"""Ratios of pairs: what their interval says, and what of a bench is compared."""

import math

import numpy as np
import pytest
from scipy.stats import binom

from motord.shm.time_count import count_time
from motord.shm.timing import Timing
from tests.benchmarks.bench_isolation import SLICES, Bench, Disturbance
from tests.benchmarks.paired import CLEAN_MIN, Pair, Seen, compared, interval_rank, median_ratio


@pytest.mark.parametrize("n", [6, 7, 20, 40, 200])
def test_the_interval_holds_the_median_with_95_percent_and_no_narrower_one_does(n: int) -> None:
    k = interval_rank(n)
    assert 2 * binom.cdf(k - 1, n, 0.5) <= 0.05 < 2 * binom.cdf(k, n, 0.5)


@pytest.mark.parametrize("n", range(6))
def test_few_pairs_have_no_interval(n: int) -> None:
    found = median_ratio([(2.0, 3.0)] * n)
    assert math.isnan(found.low)
    assert math.isnan(found.high)
    assert math.isnan(found.median) == (n == 0)


def test_intervals_of_any_distribution_hold_its_median() -> None:
    random = np.random.default_rng(7)
    held = 0
    for _ in range(1000):
        found = median_ratio([(1.0, ratio) for ratio in random.lognormal(0.0, 2.0, 30)])
        held += found.low <= 1.0 <= found.high
    assert 940 <= held <= 985  # 95.7 % for 30 pairs


def test_what_drifts_cancels() -> None:
    drift = np.geomspace(1.0, 10.0, 20)
    assert median_ratio([(x, 1.1 * x) for x in drift]) == pytest.approx((1.1, 1.1, 1.1))


def a_half(late_us: float, clean: int = SLICES) -> Seen:
    seen = Seen()
    for at in range(SLICES):
        part = Timing()
        for _ in range(100):
            count_time(part.wake_late.cells, round(late_us * 1e3))
            count_time(part.work.cells, 500)
        (seen.loop.clean if at < clean else seen.loop.stolen).append(part)
    return seen


def test_a_pair_counts_if_both_halves_are_clean_enough() -> None:
    good = [Pair(a_half(10.0 * n), a_half(15.0 * n)) for n in range(1, 9)]
    stolen = [Pair(a_half(10.0), a_half(90.0, CLEAN_MIN - 1)), Pair(a_half(1.0, 0), a_half(90.0))]
    late, high, work, _ = compared("x", good + stolen, True)
    assert late.value == pytest.approx(1.5, rel=0.04)
    assert high.value == pytest.approx(1.5, rel=0.07)
    assert high.bound == late.bound == 2.0
    assert "8 of 10 pairs" in late.note
    assert work.value == 1.0  # below a microsecond it is one


def test_without_pairs_nothing_is_measured() -> None:
    assert [figure.met for figure in compared("x", [], False)] == [None] * 4


def test_the_order_alternates(monkeypatch: pytest.MonkeyPatch) -> None:
    bench, order = object.__new__(Bench), []

    def slices() -> Seen:
        order.append("slices")
        return a_half(10.0)

    monkeypatch.setattr(bench, "slices", slices)
    monkeypatch.setattr("tests.benchmarks.bench_isolation.ENOUGH_PAIRS", 2)
    pairs = bench.compare(
        Disturbance("x", lambda: order.append("begin"), lambda: order.append("end")), math.inf
    )
    assert len(pairs) == 2
    assert order == ["slices", *["begin", "slices", "end"] * 2, "slices"]
