"""Errors of the joint estimator from turns and points, against trials of a small linear model."""

import numpy as np
import pytest

from motord.experiments.calibration.estimate.least_squares.deviations import (
    DeviationBlocks,
    PointScores,
)
from motord.experiments.calibration.estimate.least_squares.identifiability import (
    COMMON,
    Identifiability,
)
from motord.experiments.calibration.estimate.least_squares.joint import (
    inverse_on_seen,
    solve,
    stated_errors,
)
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    DELAY,
    FIRST_COGGING,
    NormalEquations,
)
from motord.experiments.calibration.estimate.least_squares.scatter import (
    VarianceEquations,
    _parts,
    _spread,
)
from motord.identification.cluster_robust_ls import equilibrated
from motord.intervals import coverage_factor
from tests.campaigns.coverage import Case, trial

ANGLE = 2 * np.pi * np.arange(48) / 48
PHASES = 2 * np.pi * np.arange(3) / 3
TRUTH = np.array([1.02, 0.97, 1.01, 0.3, -0.1, -0.2, 0.0, 0.0, 0.06, -0.02])
TRUTH[ALPHA] /= np.cbrt(TRUTH[ALPHA].prod())
INDEPENDENT = Identifiability(COMMON, offset_seen=False)


def columns(torque_Nm: float) -> np.ndarray:
    """Independent phases: neither a common gain nor a common offset makes ripple."""
    waves = np.zeros((ANGLE.size, TRUTH.size))
    waves[:, ALPHA] = torque_Nm / 3 * np.cos(2 * (ANGLE[:, None] - PHASES))
    waves[:, BETA] = 0.2 * np.cos(ANGLE[:, None] - PHASES)
    waves[:, DELAY] = 0.01 * np.sin(3 * ANGLE)
    waves[:, FIRST_COGGING] = np.cos(2 * ANGLE)
    waves[:, FIRST_COGGING + 1] = np.sin(2 * ANGLE)
    return waves


def normals(
    torques_Nm: tuple[float, ...], turns: int, scatter: float, rng: np.random.Generator
) -> NormalEquations:
    lefts, rights = [], []
    for torque_Nm in torques_Nm:
        x, theta = columns(torque_Nm), TRUTH.copy()
        theta[ALPHA] *= 1 + scatter * rng.standard_normal(3)
        for _ in range(turns):
            y = x @ theta + 0.02 * rng.standard_normal(ANGLE.size)
            lefts.append(x.T @ x / 0.02**2)
            rights.append(x.T @ y / 0.02**2)
    left = np.array(lefts)
    return NormalEquations(left, np.zeros_like(left), np.array(rights))


@pytest.mark.parametrize("scatter", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("torques_Nm", [(1.0, 3.0, 5.0), (1.0, 1.0, 3.0, 3.0, 5.0, 5.0)], ids=len)
def test_intervals_hold_the_truth(torques_Nm: tuple[float, ...], scatter: float) -> None:
    rng = np.random.default_rng(5)
    held = []
    for _ in range(80):
        one = normals(torques_Nm, 5, scatter, rng)
        found = solve(one.left, one.right.sum(axis=0), INDEPENDENT)
        point = np.repeat(np.arange(len(torques_Nm)), 5)
        errors = stated_errors(one, point, found, INDEPENDENT)
        factor = np.array([coverage_factor(freedom) for freedom in errors.freedom])
        inside = np.abs(found.vector[:-1] - TRUTH) <= (factor * errors.stderr)[:-1]
        held.append(inside[[0, 1, 2, 3, 4, 5, 8, 9]])
    covered = np.mean(held, axis=0)
    assert covered.min() > 0.85
    assert 0.90 <= covered.mean() <= 0.995


def test_the_scatter_of_gains_is_in_the_errors_and_costs_freedom() -> None:
    rng = np.random.default_rng(3)
    stated = {}
    for scatter in (0.0, 0.02):
        one = normals((1.0, 3.0, 5.0, 1.0, 3.0, 5.0), 8, scatter, rng)
        found = solve(one.left, one.right.sum(axis=0), INDEPENDENT)
        stated[scatter] = stated_errors(one, np.repeat(np.arange(6), 8), found, INDEPENDENT)
    assert (stated[0.02].stderr[ALPHA] > 4 * stated[0.0].stderr[ALPHA]).all()
    assert (stated[0.02].freedom[ALPHA] < 12).all()


@pytest.mark.parametrize("connection", ["star", "independent"])
def test_trials_of_the_campaign(connection: str) -> None:
    rows = trial(Case(1, connection, commands=False, points=3, scatter=0.01, seed=2))
    assert {kind for kind, *_ in rows} >= {"alpha", "beta", "amplitude", "phase"}
    assert max(abs(ratio) for _, ratio, _ in rows) < 2.5


SHOWN = [0, 1, 2, 3, 4, 5, 8, 9]
"""Places of gains, offsets and cogging torque."""

TORQUES_Nm = (1.0, 3.0, 5.0, 1.0, 3.0, 5.0)


def by_turns(one: NormalEquations, turns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return variances by how turns differ: as stated, and by each point alone."""
    point = np.repeat(np.arange(len(TORQUES_Nm)), turns)
    found = solve(one.left, one.right.sum(axis=0), INDEPENDENT)
    inverse = inverse_on_seen(one.left, INDEPENDENT)
    stated = PointScores.of(one, point, found.theta, inverse)
    scores = (one.right - one.torque @ found.theta).reshape(len(TORQUES_Nm), turns, -1)
    alone = turns * np.array([np.cov(here.T) for here in scores])
    both = inverse @ np.array([stated.noise.sum(axis=0), alone.sum(axis=0)]) @ inverse.T
    return np.diag(both[0]), np.diag(both[1])


def test_a_few_turns_of_each_point_share_their_noise() -> None:
    rng = np.random.default_rng(7)
    trials = [normals(TORQUES_Nm, 2, 0.0, rng) for _ in range(200)]
    found = np.array([by_turns(one, 2) for one in trials])[:, :, SHOWN]
    pooled, alone = np.swapaxes(found, 0, 1)
    white = np.diag(inverse_on_seen(trials[0].left, INDEPENDENT))[SHOWN]
    assert np.sqrt(pooled.mean(axis=0) / white) == pytest.approx(1.0, abs=0.1)
    assert (pooled.std(axis=0) < 0.75 * alone.std(axis=0)).all()


@pytest.mark.parametrize(("turns", "most"), [(40, 0.15), (200, 0.04)])
def test_many_turns_speak_for_their_point(turns: int, most: float) -> None:
    rng = np.random.default_rng(8)
    one = normals(TORQUES_Nm, turns, 0.0, rng)
    found = solve(one.left, one.right.sum(axis=0), INDEPENDENT)
    apart = one.right - one.torque @ found.theta
    louder = np.repeat([1.0, 1.0, 4.0, 1.0, 1.0, 1.0], turns)[:, None]
    loud = NormalEquations(one.torque, one.law, one.right + (louder - 1) * apart)
    pooled, alone = by_turns(loud, turns)
    assert np.sqrt(pooled[SHOWN] / alone[SHOWN]) == pytest.approx(1.0, abs=most)


def poor_points(seed: int) -> PointScores:
    """Return points of two turns whose instruments are mostly noise."""
    rng = np.random.default_rng(seed)
    lefts, rights = [], []
    for torque_Nm in np.repeat([1.0, 2.0, 3.0, 4.0], 2):
        x = columns(torque_Nm)
        size = np.linalg.norm(x, axis=0) / np.sqrt(ANGLE.size)
        instruments = (x + 2 * size * rng.standard_normal(x.shape)) / 0.02**2
        y = x @ TRUTH + 0.02 * rng.standard_normal(ANGLE.size)
        lefts.append(instruments.T @ x)
        rights.append(instruments.T @ y)
    left = np.array(lefts)
    one = NormalEquations(left, np.zeros_like(left), np.array(rights))
    inverse = inverse_on_seen(one.left, INDEPENDENT)
    return PointScores.of(one, np.repeat(np.arange(4), 2), TRUTH, inverse)


@pytest.mark.parametrize("seed", range(12))
def test_covariances_by_poor_instruments_are_covariances(seed: int) -> None:
    """One of the twelve had a negative eigenvalue, which ended with a traceback."""
    points = poor_points(seed)
    parts = list(_parts(np.ones(3), TRUTH.size, INDEPENDENT))
    blocks = DeviationBlocks.of(points, parts, np.zeros(len(parts)))
    equations = VarianceEquations.of(points, blocks)
    spread = _spread(points, blocks, equations.by_size(), equations.noise)
    correlation = equilibrated(spread[np.ix_(equations.seen, equations.seen)])[0]
    assert np.linalg.eigvalsh(correlation).min() > 0
    variance = equations.by_covariance(spread)
    assert np.isfinite(variance).all()
    assert (variance >= 0).all()


def test_the_noise_of_points_goes_with_the_units_of_their_parameters() -> None:
    """Offsets (A) and harmonics (Nm) of a motor a thousandth in size had intervals of their own."""
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(12, 5, 4))  # turns, samples, parameters
    left, right = np.swapaxes(rows, 1, 2) @ rows, rng.normal(size=(12, 4))
    size, point = np.array([1.0, 1e-3, 1e-3, 0.1]), np.repeat([0, 1, 2], 4)

    def scores(unit: np.ndarray) -> PointScores:
        lefts = left * np.outer(unit, unit)
        normals = NormalEquations(lefts, np.zeros_like(lefts), right * unit)
        return PointScores.of(normals, point, np.zeros(4), np.eye(4))

    plain, small = scores(np.ones(4)), scores(size)
    np.testing.assert_allclose(small.noise, plain.noise * np.outer(size, size), rtol=1e-9)
    np.testing.assert_allclose(small.doubt, plain.doubt)
