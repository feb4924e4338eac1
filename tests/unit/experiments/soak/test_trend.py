"""Slopes with intervals that hold for residuals of any correlation from one to the next."""

import numpy as np
import pytest

from motord.experiments.soak.result import FigureTrend, SoakResult
from motord.experiments.soak.step import most_likely_step
from motord.experiments.soak.trend import LEAST, slope
from motord.intervals import beyond_chance


def wandering(rng, n: int, correlation: float) -> np.ndarray:
    """Return residuals (n,) of which each remembers the one before."""
    white = rng.normal(size=n)
    values = np.empty(n)
    values[0] = white[0] / np.sqrt(1 - correlation**2)
    for place in range(1, n):
        values[place] = correlation * values[place - 1] + white[place]
    return values


@pytest.mark.parametrize(("n", "correlation"), [(8, 0.0), (24, 0.0), (24, 0.6), (60, 0.7)])
def test_the_interval_covers_the_slope(n, correlation):
    rng, hours = np.random.default_rng([n, int(10 * correlation)]), 0.1 * np.arange(n)
    found = [slope(hours, 5.0 + 3.0 * hours + wandering(rng, n, correlation)) for _ in range(100)]
    covers = [abs(one.value - 3.0) <= one.half_width for one in found]
    assert 90 <= sum(covers) <= 100


def test_the_interval_is_not_wider_than_white_noise_asks_for_by_much():
    rng, hours = np.random.default_rng(1), 0.1 * np.arange(60)
    spread = 1 / np.sqrt(((hours - hours.mean()) ** 2).sum())
    widths = [slope(hours, wandering(rng, 60, 0.0)).half_width for _ in range(30)]
    assert 1.9 * spread < np.median(widths) < 2.6 * spread


def test_without_a_drift_few_are_claimed_and_a_clear_one_is_found():
    rng, hours = np.random.default_rng(2), 0.1 * np.arange(24)
    claimed = found = 0
    for _ in range(100):
        steady = [slope(hours, wandering(rng, 24, 0.5)).p_value for _ in range(5)]
        claimed += any(beyond_chance(steady, 0.05))
        drift = slope(hours, 6.0 * hours + wandering(rng, 24, 0.5)).p_value
        found += beyond_chance([*steady, drift], 0.05)[-1]
    assert claimed <= 11
    assert found >= 90


def test_values_without_scatter_have_their_slope_and_the_rounding_of_their_steps():
    hours = np.arange(8.0)
    counts, straight = slope(hours, np.zeros(8), counts=True), slope(hours, 2.0 + 0.5 * hours)
    assert (counts.value, counts.half_width, counts.p_value) == (0.0, 0.0, 1.0)
    assert straight.value == pytest.approx(0.5)
    assert 0 < straight.p_value < 1e-5
    assert 0 < straight.half_width < 0.1


@pytest.mark.parametrize(("n", "rise"), [(8, 0.7), (20, 0.7), (50, 1.5), (20, 10.0)])
def test_the_interval_holds_for_readings_in_steps(n, rise):
    covers, known = 0, 0
    for seed in range(100):
        rng, hours = np.random.default_rng(seed), np.linspace(0.0, 1.0, n)
        values = rng.uniform() + rise * hours + 0.02 * rng.normal(size=n)
        found = slope(hours, np.round(values))
        if found.half_width is not None:
            known += 1
            covers += abs(found.value - rise) <= found.half_width
    assert known >= 60
    assert covers >= 0.94 * known


@pytest.mark.parametrize("n", [10, 20, 50])
def test_after_a_gap_residuals_resemble_those_before_as_little_as_time_makes_them(n):
    place = np.arange(n) + n * (np.arange(n) >= n // 2)
    covers = 0
    for seed in range(200):
        values = wandering(np.random.default_rng(seed), 2 * n, 0.8)
        found = slope(0.1 * place, values[place])
        covers += abs(found.value) <= found.half_width
    assert covers >= 0.94 * 200 - 2.5 * np.sqrt(200 * 0.94 * 0.06)


def test_of_too_few_values_no_interval_is_stated():
    few = slope(np.arange(LEAST - 1.0), np.array([1.0, 2.0, 2.5, 4.0, 5.0]))
    assert few.value == pytest.approx(1.0, rel=0.1)
    assert (few.stderr, few.half_width, few.p_value) == (None, None, None)
    assert beyond_chance([None, 1e-9], 0.05) == [False, True]
    assert beyond_chance([0.03, 0.5, 0.9], 0.05) == [False] * 3
    assert beyond_chance([0.03, 0.01], 0.05) == [True, True]


@pytest.mark.parametrize("level", [22.1, -1e-9, 3e12])
def test_constant_values_have_a_slope_of_unknown_error_and_hide_no_drift_of_others(level):
    for n in range(6, 51):
        hours = 0.1 * np.arange(n)
        still = slope(hours, np.full(n, level))
        assert (still.value, still.half_width, still.p_value) == (0.0, None, None)
    drift = slope(hours, 40.0 * hours + wandering(np.random.default_rng(3), n, 0.3))
    assert beyond_chance([still.p_value, drift.p_value], 0.05) == [False, True]
    assert slope(np.arange(3.0), np.full(3, level)).value == 0.0


def test_values_that_creep_by_less_than_their_rounding_have_a_slope():
    hours = np.arange(10.0)
    found = slope(hours, 1.0 + 3e-12 * hours / 10)
    assert found.value == pytest.approx(3e-13, rel=0.01)
    assert most_likely_step(hours, 1.0 + 3e-12 * hours / 10).p_value > 0.05


def test_what_is_not_finite_is_no_drift_and_hides_none():
    assert beyond_chance([float("nan"), 1e-9, 0.9], 0.05) == [False, True, False]


def test_a_slope_is_the_same_in_any_unit():
    rng, hours = np.random.default_rng(5), 0.1 * np.arange(12)
    values = 3.0 * hours + wandering(rng, 12, 0.4)
    one, small = slope(hours, values), slope(hours, 1e-200 * values)
    assert small.half_width == pytest.approx(1e-200 * one.half_width)
    assert small.p_value == pytest.approx(one.p_value)


@pytest.mark.parametrize("n", [8, 10, 20])
def test_of_strongly_correlated_repetitions_few_soaks_claim_a_drift(n):
    rng, at = np.random.default_rng(n), np.linspace(0.0, 1.0, n)
    claimed = [
        any(beyond_chance([slope(at, wandering(rng, n, 0.8)).p_value for _ in range(12)], 0.05))
        for _ in range(100)
    ]
    assert sum(claimed) <= 10  # 5, and 2.5 standard deviations


@pytest.mark.parametrize(("correlation", "noted"), [(0.5, 0), (0.95, 1)])
def test_a_correlation_beyond_what_intervals_hold_for_is_a_finding(correlation, noted):
    rng, hours = np.random.default_rng(6), 0.1 * np.arange(50)
    series = [wandering(rng, 50, correlation) for _ in range(5)] + 6 * [np.full(50, 22.1)]
    trends = [FigureTrend(str(k), "%", hours, y, slope(hours, y)) for k, y in enumerate(series)]
    found = SoakResult("verify", (), tuple(trends)).findings
    assert [one.limit for one in found] == [0.8] * noted
