"""Errors of the joint estimator: of turns within operating points, and of the points themselves.

With scores s = right - left theta of each turn, influence B of the scores on what is stated, and
left N_j of point j:

    V = sum_j B S_j B' + sum_b tau_b^2 B (sum_j N_j D_b N_j) B' + prior

S_j is the scatter of the scores between the turns of a point: noise may have any colour within a
turn. tau_b^2 is the variance by which a block of parameters (gains of the phases, that of the
torque sensor, offsets, each cogging order) differs from point to point: it is found from what the
points' scores are more than turns explain (ANOVA estimates of variance components, not negative;
Searle, Casella and McCulloch 1992). Degrees of freedom are Satterthwaite's, over all that was
estimated.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from motord.experiments.calibration.estimate.identifiability import COMMON, Identifiability
from motord.experiments.calibration.estimate.normal_equations import (
    ALPHA,
    BETA,
    FIRST_COGGING,
    NormalEquations,
)
from motord.identification.variance_components import VarianceComponents

ROUNDS = 2
"""Rounds of estimating tau: the weights of the points follow from it."""

SOLUTIONS = 5
"""Solutions for tau in a round: their weights follow from it as well."""

SEEN_SHARE = 1e-6
"""Part of a block's scatter below which the fit takes up all of it: the points are too few."""

LEAST_SHARE = 0.05
"""Part of a block's white noise that the fit leaves, at least: weak instruments may say less."""


@dataclass(frozen=True)
class PointScores:
    """The points, J of them: left (J, p, p), scores (J, p), noise (J, p, p), turns (J,).

    noise: covariance of the scores by how turns differ; inverse (p, p): of the whole left-hand
    side on what is seen.
    """

    left: np.ndarray
    scores: np.ndarray
    noise: np.ndarray
    turns: np.ndarray
    inverse: np.ndarray

    @classmethod
    def of(
        cls, normals: NormalEquations, point: np.ndarray, theta: np.ndarray, inverse: np.ndarray
    ) -> "PointScores":
        """Sum up the turns, point (b,): index of each turn's point."""
        lefts = normals.torque + normals.law
        scores = normals.right - lefts @ theta
        left, total, noise, turns = [], [], [], []
        for one in np.unique(point):
            here = scores[point == one]
            apart = here - here.mean(axis=0)
            left.append(lefts[point == one].sum(axis=0))
            total.append(here.sum(axis=0))
            noise.append(apart.T @ apart * len(here) / max(len(here) - 1, 1))
            turns.append(len(here))
        return cls(np.array(left), np.array(total), np.array(noise), np.array(turns), inverse)


@dataclass(frozen=True)
class _Parts:
    """Parameters that deviate together, root (p, r), and those that show it, probe (p, r')."""

    root: np.ndarray
    probe: np.ndarray


@dataclass(frozen=True)
class _Block:
    """What deviations of some parameters cause, and the weights by which they are looked for.

    caused (J, p, r): scores that unit deviations make. weight (J, p, r'): Q = sum of (weight' s)^2;
    through (J, r', p): weight of what the fit takes from the scores of all points.
    """

    caused: np.ndarray
    weight: np.ndarray
    through: np.ndarray
    total: np.ndarray

    @classmethod
    def of(cls, points: PointScores, parts: "_Parts", variance: float) -> "_Block":
        caused, probe = points.left @ parts.root, parts.probe
        seen = probe.T @ points.left @ probe
        seen = (seen + np.swapaxes(seen, 1, 2)) / 2
        values, vectors = np.linalg.eigh(seen + variance * seen @ seen)
        least = 1e-9 * np.maximum(values[:, -1:], 1e-290)
        scale = np.where(values > least, 1 / np.sqrt(np.maximum(values, least)), 0.0)
        weight = probe @ (vectors * scale[:, None, :])
        through = np.swapaxes(weight, 1, 2) @ points.left @ points.inverse
        return cls(caused, weight, through, np.einsum("jpr,jqr->pq", caused, caused))

    def seen_in(self, other: "_Block") -> float:
        """Return the mean of Q where the parameters of `other` have variance 1."""
        own = np.swapaxes(self.weight, 1, 2) @ other.caused
        taken = self.through @ other.caused
        rest = np.einsum("jrp,pq,jrq->", self.through, other.total, self.through)
        return float((own * own).sum() - 2 * (own * taken).sum() + rest)

    def mean(self, covariances: np.ndarray) -> np.ndarray:
        """Return the part of each point in the mean of Q, with covariances (J, p, p) of scores."""
        own = np.einsum("jpr,jpq,jqr->j", self.weight, covariances, self.weight)
        cross = np.einsum("jpr,jpq,jrq->j", self.weight, covariances, self.through)
        taken = np.einsum("krp,krq->pq", self.through, self.through)
        return np.asarray(own - 2 * cross + np.einsum("pq,jpq->j", taken, covariances))

    def covariance_with(self, other: "_Block", covariances: np.ndarray) -> np.ndarray:
        """Return the covariance (J r, J r') of both blocks' weighted scores."""
        points, _, rank = self.weight.shape
        own = np.swapaxes(self.weight, 1, 2) @ covariances
        right = covariances @ other.weight
        full = -np.einsum("jrp,ksp->jrks", own, other.through)
        full -= np.einsum("jrp,kps->jrks", self.through, right)
        full += np.einsum(
            "jrp,pq,ksq->jrks", self.through, covariances.sum(axis=0), other.through, optimize=True
        )
        for j in range(points):
            full[j, :, j] += own[j] @ other.weight[j]
        return np.asarray(full.reshape(points * rank, -1))


def _parts(alpha: np.ndarray, parameters: int, identifiable: Identifiability) -> Iterator[_Parts]:
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
        yield _Parts(gains, gains @ apart)
        roots.append(gains @ COMMON[:, None])
    else:
        roots.append(gains @ apart)
    for root in roots:
        yield _Parts(root, root)


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
        np.ones(points.turns.size),
        np.diag(2.0 / np.maximum(points.turns - 1, 1)),
    )
    found = turns + VarianceComponents.known(influence @ prior @ influence.T)
    if points.turns.size > 1:
        parts = list(_parts(alpha, points.scores.shape[1], identifiable))
        found += _between(points, parts, influence)
    return found


def _between(points: PointScores, parts: list[_Parts], influence: np.ndarray) -> VarianceComponents:
    """Return the errors that come from deviations of whole operating points."""
    variance = np.zeros(len(parts))
    for _ in range(ROUNDS):
        blocks = [_Block.of(points, one, v) for one, v in zip(parts, variance, strict=True)]
        variance, doubt = _variances(points, blocks)
    caused = np.array([influence @ block.total @ influence.T for block in blocks])
    return VarianceComponents(caused, variance, doubt)


def _variances(points: PointScores, blocks: list[_Block]) -> tuple[np.ndarray, np.ndarray]:
    """Return the variance of each block's parameters between points, and its covariance."""
    q = np.array([(np.einsum("jpr,jp->jr", b.weight, points.scores) ** 2).sum() for b in blocks])
    noise = np.array([block.mean(points.noise) for block in blocks])
    gain = np.array([[one.seen_in(other) for other in blocks] for one in blocks])
    full = [(np.einsum("jpr,jps->jrs", b.weight, b.caused) ** 2).sum() for b in blocks]
    seen = np.flatnonzero(np.diag(gain) > SEEN_SHARE * np.array(full))
    variance, doubt = np.zeros(len(blocks)), np.zeros(2 * (len(blocks),))
    if seen.size == 0:
        return variance, doubt
    gain, noise, q = gain[np.ix_(seen, seen)], noise[seen], q[seen]
    unit = np.diag(gain)
    expected = noise.sum(axis=1) + q
    for _ in range(SOLUTIONS):  # the scatter of a sum of squares is in proportion to its mean
        row = 1 / np.maximum(expected, 1e-300)
        scaled = nnls(row[:, None] * gain / unit, row * (q - noise.sum(axis=1)))[0]
        expected = noise.sum(axis=1) + gain @ (scaled / unit)
    variance[seen] = scaled / unit
    spread = _spread(points, [blocks[n] for n in seen], variance[seen], noise)
    inverse = np.zeros_like(gain)
    active = np.flatnonzero(scaled > 0)
    inverse[np.ix_(active, active)] = np.linalg.pinv(gain[np.ix_(active, active)])
    doubt[np.ix_(seen, seen)] = inverse @ spread @ inverse.T
    return variance, doubt


def _spread(
    points: PointScores, blocks: list[_Block], variance: np.ndarray, noise: np.ndarray
) -> np.ndarray:
    """Return the covariance of the blocks' sums of squares less their noise (J,) each."""
    ranks = np.array([block.weight.shape[2] for block in blocks])
    white = np.array([block.mean(points.left).sum() for block in blocks])
    white = np.maximum(white, LEAST_SHARE * points.turns.size * ranks)
    colour = np.sqrt(np.maximum(noise.sum(axis=1), 0) / white)
    caused = sum(
        v * b.caused @ np.swapaxes(b.caused, 1, 2) for v, b in zip(variance, blocks, strict=True)
    )
    spread = np.empty(2 * (len(blocks),))
    for i, one in enumerate(blocks):
        for j, other in enumerate(blocks[: i + 1]):
            covariance = one.covariance_with(other, colour[i] * colour[j] * points.left + caused)
            spread[i, j] = spread[j, i] = 2 * (covariance**2).sum()
    freedom = np.maximum(points.turns - 1, 1)
    return np.asarray(spread + np.diag((2 * noise**2 / freedom).sum(axis=1) / ranks))
