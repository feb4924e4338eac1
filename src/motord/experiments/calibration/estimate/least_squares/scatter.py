"""Errors of the joint estimator: of turns within operating points, and of the points themselves.

With scores s = right - left theta of each turn, influence B of the scores on what is stated, and
left N_j of point j:

    V = sum_j B S_j B' + sum_b tau_b^2 B (sum_j N_j D_b N_j) B' + prior

S_j is the scatter of the scores between the turns of a point: noise may have any colour within a
turn. tau_b^2 is the variance by which a block of parameters (gains of the phases, that of the
torque sensor, offsets, each cogging order) differs from point to point: it is found from what the
points' scores are more than turns explain (ANOVA estimates of variance components, not negative;
Searle, Casella and McCulloch 1992), by generalised least squares: sums of squares of different
blocks are correlated, and their covariance weighs them (Browne 1974). Degrees of freedom are
Satterthwaite's, over all that was estimated.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from motord.experiments.calibration.estimate.least_squares.deviations import (
    DeviatingParts,
    DeviationBlocks,
    PointScores,
)
from motord.experiments.calibration.estimate.least_squares.identifiability import (
    COMMON,
    Identifiability,
)
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    FIRST_COGGING,
)
from motord.identification.cluster_robust_ls import equilibrated
from motord.identification.variance_components import VarianceComponents

ROUNDS = 2
"""Rounds of estimating tau: the weights of the points follow from it."""

SOLUTIONS = 5
"""Solutions for tau in a round: their weights follow from it as well."""

ALIKE = 1e-6
"""Part by which sums of squares that show the same are taken to differ."""

SEEN_SHARE = 1e-6
"""Part of a block's scatter below which the fit takes up all of it: the points are too few."""

TURNS, POINTS, PRIORS = "noise of turns", "differences between operating points", "priors"
"""Sources of the errors' parts."""

LEAST_SHARE = 0.05
"""Part of a block's white noise that the fit leaves, at least: weak instruments may say less."""


def _parts(
    alpha: np.ndarray, parameters: int, identifiable: Identifiability
) -> Iterator[DeviatingParts]:
    """Yield what may differ from point to point.

    Where the common gain is seen, the torque sensor's may differ as well as that of each phase:
    the phases' is found by how they differ from each other.
    """
    unit, gains = np.eye(parameters), np.zeros((parameters, 3))
    gains[ALPHA] = np.diag(alpha)
    apart = np.linalg.svd(COMMON[:, None])[0][:, 1:]
    roots = [unit[:, BETA] if identifiable.offset_seen else unit[:, BETA] @ apart]
    roots += [unit[:, first : first + 2] for first in range(FIRST_COGGING, parameters, 2)]
    if identifiable.gain_direction is None:
        yield DeviatingParts(gains, gains @ apart)
        roots.append(gains @ COMMON[:, None])
    else:
        roots.append(gains @ apart)
    for root in roots:
        yield DeviatingParts(root, root)


def errors(
    points: PointScores,
    alpha: np.ndarray,
    influence: np.ndarray,
    prior: np.ndarray,
    identifiable: Identifiability,
) -> VarianceComponents:
    """Return the errors of what is stated; influence (k, p) of scores on it, prior (p, p)."""
    turns = VarianceComponents(
        influence @ points.noise @ influence.T,
        np.ones(len(points.doubt)),
        points.doubt,
        (TURNS,) * len(points.doubt),
    )
    found = turns + VarianceComponents.known(influence @ prior @ influence.T, PRIORS)
    if len(points.doubt) > 1:
        parts = list(_parts(alpha, points.scores.shape[1], identifiable))
        found += _between(points, parts, influence)
    return found


def _between(
    points: PointScores, parts: list[DeviatingParts], influence: np.ndarray
) -> VarianceComponents:
    """Return the errors that come from deviations of whole operating points."""
    variance = np.zeros(len(parts))
    for _ in range(ROUNDS):
        blocks = DeviationBlocks.of(points, parts, variance)
        equations = VarianceEquations.of(points, blocks)
        variance = equations.by_size()
    variance = equations.by_covariance(_spread(points, blocks, variance, equations.noise))
    doubt = equations.doubt(variance, _spread(points, blocks, variance, equations.noise))
    caused = influence @ blocks.total @ influence.T
    return VarianceComponents(caused, variance, doubt, (POINTS,) * len(parts))


@dataclass(frozen=True)
class VarianceEquations:
    """Linear equations for the variance of each block's parameters between points, m of them seen.

    q (m,): sums of squares; noise (blocks, J): what turns make of each, by points; gain (m, m):
    what unit variances of the parameters add; seen (m,): their blocks.
    """

    q: np.ndarray
    noise: np.ndarray
    gain: np.ndarray
    seen: np.ndarray

    @classmethod
    def of(cls, points: PointScores, blocks: DeviationBlocks) -> "VarianceEquations":
        """Return the equations that the points' scores give."""
        gain, full = blocks.gain()
        seen = np.flatnonzero(np.diag(gain) > SEEN_SHARE * full)
        q = blocks.squares(points.scores)[seen]
        return cls(q, blocks.means(points.noise), gain[np.ix_(seen, seen)], seen)

    def by_size(self) -> np.ndarray:
        """Return the variances (blocks,) with each sum of squares in proportion to its mean."""
        by_turns, unit = self.noise[self.seen].sum(axis=1), np.diag(self.gain)
        expected = by_turns + self.q
        scaled = np.zeros(self.q.size)
        for _ in range(SOLUTIONS if self.q.size else 0):
            row = 1 / np.maximum(expected, 1e-300)
            scaled = nnls(row[:, None] * self.gain / unit, row * (self.q - by_turns))[0]
            expected = by_turns + self.gain @ (scaled / unit)
        return self._of_blocks(scaled / unit)

    def by_covariance(self, spread: np.ndarray) -> np.ndarray:
        """Return the variances (blocks,) with the sums weighed by their covariance, that of all.

        Deviations of one block show in the sums of the others. Where these are less than that, a
        variance cannot come out negative, and equations that all count alike would take it out of
        the block that shows it best.
        """
        if not self.seen.size:
            return self._of_blocks(self.q)
        correlation, scale = equilibrated(spread[np.ix_(self.seen, self.seen)])
        correlation, unit = correlation + ALIKE * np.eye(scale.size), np.diag(self.gain)
        rest = scale * (self.q - self.noise[self.seen].sum(axis=1))
        rows = np.column_stack([scale[:, None] * self.gain / unit, rest])
        rows = np.linalg.solve(np.linalg.cholesky(correlation), rows)
        return self._of_blocks(nnls(rows[:, :-1], rows[:, -1])[0] / unit)

    def doubt(self, variance: np.ndarray, spread: np.ndarray) -> np.ndarray:
        """Return the covariance (blocks, blocks) of variances, spread: that of all sums."""
        inverse = np.zeros_like(self.gain)
        active = np.flatnonzero(variance[self.seen] > 0)
        inverse[np.ix_(active, active)] = np.linalg.pinv(self.gain[np.ix_(active, active)])
        doubt, pairs = np.zeros_like(spread), np.ix_(self.seen, self.seen)
        doubt[pairs] = inverse @ spread[pairs] @ inverse.T
        return doubt

    def _of_blocks(self, values: np.ndarray) -> np.ndarray:
        found = np.zeros(len(self.noise))
        found[self.seen] = values
        return found


def _spread(
    points: PointScores, blocks: DeviationBlocks, variance: np.ndarray, noise: np.ndarray
) -> np.ndarray:
    """Return the covariance of the blocks' sums of squares less their noise (blocks, J)."""
    left = _as_covariance(points.left)
    white = blocks.means(left).sum(axis=1)
    white = np.maximum(white, LEAST_SHARE * len(points.doubt) * blocks.ranks)
    colour = np.sqrt(np.maximum(noise.sum(axis=1), 0) / white)
    sizes = np.diff(blocks.roots, append=blocks.caused.shape[2])
    caused = blocks.caused * np.repeat(variance, sizes) @ np.swapaxes(blocks.caused, 1, 2)
    by_turns = np.einsum("bj,jk,bk->b", noise, points.doubt, noise) / blocks.ranks
    return np.asarray(blocks.spread(left, colour, caused) + np.diag(by_turns))


def _as_covariance(left: np.ndarray) -> np.ndarray:
    """Return the nearest covariances to left-hand sides (J, p, p): poor instruments make none."""
    values, vectors = np.linalg.eigh((left + np.swapaxes(left, 1, 2)) / 2)
    return np.asarray((vectors * np.maximum(values, 0)[:, None, :]) @ np.swapaxes(vectors, 1, 2))
