"""Gains that differ from point to point, or all in common, are no departure of the bench."""

import numpy as np
import pytest

from motord.experiments.calibration.estimate.current_tables import beyond_noise
from motord.experiments.calibration.estimate.lack_of_fit.gain_scatter import (
    GainDirections,
    GainScatter,
)
from motord.experiments.calibration.estimate.least_squares.scatter import VarianceEquations
from tests.campaigns.coverage import Case


@pytest.mark.parametrize("variance", [0.0, 1e-4])
def test_the_variance_of_the_gains_is_found_without_bias(variance: float) -> None:
    rng = np.random.default_rng(1)
    spread = rng.uniform(0.1, 3.0, (400, 12)) * 1e6
    squares = (1 + variance * spread) * rng.standard_normal(spread.shape) ** 2
    found = [GainScatter.of(e2, q, np.zeros(q.size)) for e2, q in zip(squares, spread, strict=True)]
    mean = np.mean([one.variance for one in found])
    assert mean == pytest.approx(variance, rel=0.05, abs=3e-7)
    stated = np.mean([one.doubt for one in found if one.variance])
    assert not variance or np.var([one.variance for one in found]) == pytest.approx(stated, rel=0.3)


@pytest.mark.parametrize("law", [0, 4])
def test_whitened_rows_have_unit_variance(law: int) -> None:
    rng = np.random.default_rng(2)
    points, orders, before = 3, 5, 2
    lines = rng.normal(size=(points, 3, orders)) + 1j * rng.normal(size=(points, 3, orders))
    further = rng.normal(size=(points, law, 3))
    size = 2 * points * orders + before + points * law
    rows = np.zeros((size, points, 3))  # what each gain of each point makes
    for j in range(points):
        for part, values in enumerate((lines[j].real, lines[j].imag)):
            first = (part * points + j) * orders
            rows[first : first + orders, j] = values.T
        first = 2 * points * orders + before + j * law
        rows[first : first + law, j] = further[j]
    caused = rows.reshape(size, -1)
    covariance = np.eye(size) + 0.7 * caused @ caused.T
    directions = GainDirections.of(lines, further, before)
    once = directions.whitened(covariance, 0.7)
    assert directions.whitened(once.T, 0.7) == pytest.approx(np.eye(size), abs=1e-12)


def test_noise_of_the_currents_is_not_in_their_tables() -> None:
    rng = np.random.default_rng(3)
    angle_rad = 2 * np.pi * np.arange(1000) / 1000
    true_A = np.column_stack([np.cos(8 * angle_rad + phase) for phase in (0.0, 2.0, 4.0)])
    tables_A = true_A + 0.02 * rng.standard_normal((2, 1000, 3))
    noise_A = np.std(tables_A.mean(axis=0) - true_A)
    assert np.std(beyond_noise(tables_A) - true_A) < 0.2 * noise_A
    assert beyond_noise(np.array([true_A, true_A])) == pytest.approx(true_A)


@pytest.mark.parametrize(
    "case",
    [
        Case(0, "star", commands=True, points=5, scatter=0.01, seed=101),
        Case(0, "star", commands=False, points=8, scatter=0.01, seed=101),
        Case(2, "star", commands=True, points=5, scatter=0.01, seed=100),
    ],
    ids=["commands", "no-commands", "common-gain-nearly-seen"],
)
def test_gains_that_scatter_are_no_departure_of_a_star(case: Case) -> None:
    _, result = case.found()
    assert [one.name for one in result.findings] == []
    assert result.dispersion == 1.0
    assert result.alpha_stderr.max() < 0.02


def test_sums_of_squares_are_weighed_by_their_covariance() -> None:
    """What a block shows clearly is not taken from it where another happens to show less."""
    equations = VarianceEquations(
        q=np.array([1.0, 0.2]),
        noise=np.zeros((2, 1)),
        gain=np.array([[1.0, 0.0], [1.0, 1.0]]),
        seen=np.arange(2),
    )
    alike = equations.by_size()
    spread = np.array([[0.1, 0.1], [0.1, 2.0]])  # the second has few degrees of freedom
    weighed = equations.by_covariance(spread)
    assert alike[0] < 0.7
    assert weighed == pytest.approx([1.0, 0.0], abs=1e-3)


@pytest.mark.parametrize(
    "case",
    [
        Case(0, "star", commands=True, points=8, scatter=0.0, seed=300),
        Case(3, "star", commands=True, points=3, scatter=0.0, seed=301),
    ],
    ids=["seen", "nearly-seen"],
)
def test_a_common_gain_that_is_measured_is_no_disagreement_with_kirchhoffs_law(case: Case) -> None:
    bench, result = case.found()
    assert bench.truth.delta * np.cbrt(np.prod(bench.truth.alpha)) != pytest.approx(1.0, abs=5e-3)
    assert [one.name for one in result.findings] == []
    assert result.alpha_stderr.max() < 1e-3
