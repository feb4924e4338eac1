"""Intervals by Student's t, and variances that are sums of parts."""

import numpy as np
import pytest

from motord.identification.variance_components import VarianceComponents
from motord.intervals import (
    LEVEL,
    coverage_factor,
    f_quantile,
    f_tail,
    file_decimals,
    freedom_of,
    half_width_of_largest,
    plus_minus,
    significant,
    standard_uncertainty,
    t_quantile,
    two_digits,
)


@pytest.mark.parametrize(
    ("freedom", "factor"),
    [(None, 1.95996), (1, 12.7062), (0.2, 12.7062), (2, 4.30265), (30, 2.04227)],
)
def test_coverage_factors_are_those_of_the_tables(freedom: float | None, factor: float) -> None:
    assert coverage_factor(freedom) == pytest.approx(factor, rel=1e-5)


@pytest.mark.parametrize("scatter", [0.0, 3.0])
def test_the_interval_of_the_largest_holds_the_largest_truth(scatter: float) -> None:
    rng, held, trials = np.random.default_rng(1), 0, 1000
    for _ in range(trials):
        truth = scatter * rng.standard_normal(60)
        values = truth + rng.standard_normal(60)
        half = half_width_of_largest(values.tolist(), [coverage_factor()] * 60)
        assert half is not None
        held += abs(values.max() - truth.max()) < half
    assert held > LEVEL * trials
    assert half_width_of_largest([1.0], [0.2]) == pytest.approx(0.2)
    assert half_width_of_largest([1.0, 2.0], [0.2, None]) is None


def test_quantiles_of_one_side() -> None:
    assert t_quantile(0.95, 4) == pytest.approx(2.13185, rel=1e-5)


def test_the_tail_of_f_is_the_rest_of_its_quantile() -> None:
    assert f_tail(f_quantile(0.99, 2, 30.5), 2, 30.5) == pytest.approx(0.01, rel=1e-9)
    tails = f_tail([-1e-9, 0.0, 3.3158, np.inf], 2, 30)  # F(0.95; 2, 30) of the tables
    assert tails.tolist() == pytest.approx([1.0, 1.0, 0.05, 0.0], rel=1e-4)


@pytest.mark.parametrize(
    ("value", "half_width", "text"),
    [
        (0.80123, 0.00341, "0.8012 +- 0.0034"),
        (0.80123, 0.001, "0.8012 +- 0.0010"),
        (-0.5, 0.25, "-0.50 +- 0.25"),
        (1234.5, 321.0, "1234 +- 321"),
        (-0.4, 16.0, "0 +- 16"),
        (-0.04, 1.1, "0.0 +- 1.1"),
        (3.0, 0.0, "3 +- 0"),
        (3.14159, float("inf"), "3.142 +- inf"),
    ],
)
def test_figures_have_the_digits_that_mean_something(
    value: float, half_width: float, text: str
) -> None:
    assert plus_minus(value, half_width) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (123.4, "120"), (99.6, "100"), (0.0341, "0.034"), (0.1, "0.10"), (0, "0"), (2.04, "2.0"),
        (9.96, "10"), (-2.0, "-2.0"), (3e-5, "3.0e-05"), (1.6e7, "1.6e+07"), (float("inf"), "inf"),
    ],
)  # fmt: skip
def test_two_digits_have_no_exponent_where_it_is_readable_without(value, text):
    assert two_digits(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (3.14e-5, "3.14e-05"),
        (-0.0012345, "-0.00123"),
        (2.0, "2.00"),
        (5123.4, "5120"),
    ],
)
def test_significant_digits_are_as_many_at_any_size(value: float, text: str) -> None:
    assert significant(value, 3) == text


@pytest.mark.parametrize(
    ("largest", "decimals"), [(0.0, 9), (5e3, 9), (0.2, 9), (0.1, 9), (0.05, 10), (4e-5, 13)]
)
def test_tables_in_files_have_nine_digits_at_least(largest: float, decimals: int) -> None:
    assert file_decimals(largest) == decimals


def test_a_known_covariance_has_all_freedom() -> None:
    known = VarianceComponents.known(np.diag([4.0, 9.0]), "data")
    assert known.stderr.tolist() == [2.0, 3.0]
    assert coverage_factor(known.freedom[0]) == pytest.approx(coverage_factor(), rel=1e-4)


def test_freedom_of_a_sum_is_satterthwaites() -> None:
    """Two means of 4 and 9 values: (v1 + v2)^2 / (v1^2 / 3 + v2^2 / 8)."""
    parts = np.array([[[0.5]], [[2.0]]])
    one, other = (
        VarianceComponents(part[None], np.ones(1), np.array([[2.0 / freedom]]), (source,))
        for part, freedom, source in zip(parts, (3, 8), ("three", "eight"), strict=True)
    )
    both = one + other
    assert both.stderr[0] ** 2 == pytest.approx(2.5)
    assert both.freedom[0] == pytest.approx(2.5**2 / (0.5**2 / 3 + 2.0**2 / 8))
    assert both.along(np.array([3.0])) == pytest.approx((3 * both.stderr[0], both.freedom[0]))
    assert both.trace(np.eye(1)) == pytest.approx((2.5, both.freedom[0]))
    assert (both.of("three")[0, 0], both.of("eight")[0, 0]) == (0.5, 2.0)


@pytest.mark.parametrize("freedom", [1.0, 2.0, 3.7, 60.0])
def test_an_interval_and_its_error_say_their_freedom(freedom):
    assert freedom_of(coverage_factor(freedom) * 0.2, 0.2) == pytest.approx(freedom)


@pytest.mark.parametrize("stderr", [0.0, 1e-12, 0.2 / 12.8])
def test_an_interval_beyond_one_degree_of_freedom_counts_as_if_it_were_alone(stderr):
    """As of one degree of freedom it shrank to a half where anything was combined with it."""
    assert standard_uncertainty(3.0, stderr, 2.8, 3.2) == standard_uncertainty(3.0, None, 2.8, 3.2)
    assert standard_uncertainty(3.0, 0.0, 3.0, 3.0) == (0.0, None, True)


@pytest.mark.parametrize("half_width", [0.0, 1.0, 1.959963, float("nan")])
def test_an_interval_that_is_no_wider_than_a_normal_one_has_many(half_width):
    assert freedom_of(half_width, 1.0) is None


def test_the_fewest_degrees_of_freedom_are_one():
    assert freedom_of(1e9, 1.0) == 1.0
    assert freedom_of(1.0, 0.0) == 1.0


@pytest.mark.parametrize(
    ("stderr", "half", "expected"),
    [
        (1.0, None, (1.0, None, True)),
        (None, 1.96, (1.0, None, False)),
        (1.0, 1.9, (1.0, None, True)),
        (1.0, coverage_factor(5.0), (1.0, 5.0, True)),
        (1.0, 10 * coverage_factor(1.0), (10 * 12.7062 / 1.959964, None, False)),
    ],
)
def test_what_a_figure_states_is_a_standard_uncertainty_with_degrees_of_freedom(
    stderr, half, expected
):
    low, high = (None, None) if half is None else (3.0 - half / 2, 3.0 + half)
    stated = standard_uncertainty(3.0, stderr, low, high)
    value, freedom, known = expected
    assert stated.value == pytest.approx(value, rel=1e-4)
    assert (stated.freedom is None, stated.known) == (freedom is None, known)
    assert freedom is None or stated.freedom == pytest.approx(freedom)


def test_a_figure_without_error_or_interval_states_nothing():
    assert standard_uncertainty(3.0, None, None, None) is None
