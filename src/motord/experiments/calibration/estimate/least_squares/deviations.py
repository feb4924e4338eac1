"""Scores of operating points with the covariance of their noise, by how turns differ.

And what deviations of parameters from point to point make of the scores, block by block.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from motord.experiments.calibration.estimate.least_squares.normal_equations import NormalEquations

POOLED_FREEDOM = 8.0
"""Degrees of freedom that the noise of all points together counts for at each of them."""

SEEN_EIGENVALUE = 1e-6
"""Eigenvalue of a point's left-hand side, in parts of its largest, below which it tells nothing."""


@dataclass(frozen=True)
class PointScores:
    """The points, J of them: left (J, p, p), scores (J, p), noise (J, p, p).

    noise: covariance of the scores by how turns differ, `doubt` (J, J) its relative covariance over
    the points; inverse (p, p): of the whole left-hand side on what is seen.
    """

    left: np.ndarray
    scores: np.ndarray
    noise: np.ndarray
    doubt: np.ndarray
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
        pooled, doubt = _pooled(np.array(left), np.array(noise), np.array(turns))
        return cls(np.array(left), np.array(total), pooled, doubt, inverse)


def _pooled(
    left: np.ndarray, noise: np.ndarray, turns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the noise of each point (J, p, p) shrunk towards that of all, and its doubt (J, J).

    What a point of few turns does not tell of its noise the others do: its colour, the covariance
    of scores whitened by the point's own left-hand side, is taken as alike, worth POOLED_FREEDOM
    degrees of freedom. That in turn is shrunk towards its mean over all parameters, so that a few
    turns that happen to be alike do not make errors small. Parameters are taken in units in which
    all points together have the same information of each (1 on the diagonal), as what is seen
    of gains, offsets (A) and harmonics (Nm) would go with the size of the motor else.
    """
    freedom = np.maximum(turns - 1, 0)
    information = np.diagonal(left.sum(axis=0))
    unit = 1 / np.sqrt(np.where(information > 0, information, 1.0))
    units = np.outer(unit, unit)
    left, noise = left * units, noise * units
    values, vectors = np.linalg.eigh((left + np.swapaxes(left, 1, 2)) / 2)
    seen = values > SEEN_EIGENVALUE * np.maximum(values[:, -1:], 1e-290)
    scale = np.where(seen, np.sqrt(np.maximum(values, 0)), 0.0)
    inverse = np.divide(1, scale, out=np.zeros_like(scale), where=seen)
    root = vectors * scale[:, None, :] @ np.swapaxes(vectors, 1, 2)
    whitening = vectors * inverse[:, None, :] @ np.swapaxes(vectors, 1, 2)
    per_turn = whitening @ noise @ whitening
    colour = np.tensordot(freedom, per_turn, 1)
    level = np.trace(colour) / max(freedom @ seen.sum(axis=1), 1)
    alike = POOLED_FREEDOM * level * (vectors * seen[:, None, :] @ np.swapaxes(vectors, 1, 2))
    every = freedom.sum() + POOLED_FREEDOM
    own = freedom / (freedom + POOLED_FREEDOM)
    shrunk = own[:, None, None] * noise + (1 - own)[:, None, None] * (
        root @ (colour + alike) @ root / every
    )
    shared = np.outer(own, 1 - own) / every
    common = np.outer(1 - own, 1 - own) * freedom.sum() / every**2 + shared + shared.T
    return shrunk / units, 2 * (np.diag(own**2 / np.maximum(freedom, 1)) + common)


@dataclass(frozen=True)
class DeviatingParts:
    """Parameters that deviate together, root (p, r), and those that show it, probe (p, r')."""

    root: np.ndarray
    probe: np.ndarray


@dataclass(frozen=True)
class DeviationBlocks:
    """What deviations of each block of parameters cause, and the weights that look for them.

    The columns of all blocks stand in a row, R of them. caused (J, p, R'): scores that unit
    deviations make. weight (J, p, R): Q of a block = sum of (weight' s)^2; through (J, R, p):
    weight of what the fit takes from the scores of all points. total (blocks, p, p): caused caused'
    over the points, taken (blocks, p, p): through' through. roots, probes: first column of each
    block in caused, and in weight and through.
    """

    caused: np.ndarray
    weight: np.ndarray
    through: np.ndarray
    total: np.ndarray
    taken: np.ndarray
    roots: np.ndarray
    probes: np.ndarray

    @classmethod
    def of(
        cls, points: PointScores, parts: Sequence[DeviatingParts], variance: np.ndarray
    ) -> "DeviationBlocks":
        """Return the blocks of parts that deviate by variances (blocks,) from point to point."""
        caused = [points.left @ one.root for one in parts]
        weight = [_weight(points, one.probe, v) for one, v in zip(parts, variance, strict=True)]
        through = [np.swapaxes(one, 1, 2) @ points.left @ points.inverse for one in weight]
        return cls(
            np.concatenate(caused, axis=2),
            np.concatenate(weight, axis=2),
            np.concatenate(through, axis=1),
            np.array([np.tensordot(one, one, ([0, 2], [0, 2])) for one in caused]),
            np.array([np.tensordot(one, one, ([0, 1], [0, 1])) for one in through]),
            _firsts(one.shape[2] for one in caused),
            _firsts(one.shape[2] for one in weight),
        )

    @property
    def ranks(self) -> np.ndarray:
        """Columns of each block's weight."""
        return np.diff(self.probes, append=self.weight.shape[2])

    def squares(self, scores: np.ndarray) -> np.ndarray:
        """Return Q of each block, of scores (J, p)."""
        seen = (np.swapaxes(self.weight, 1, 2) @ scores[:, :, None])[:, :, 0]
        return np.add.reduceat((seen**2).sum(axis=0), self.probes)

    def gain(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the means of Q where the parameters of each block have variance 1.

        (blocks of Q, blocks of parameters); and those (blocks,) of a block by itself, if the fit
        took nothing.
        """
        own = np.swapaxes(self.weight, 1, 2) @ self.caused
        left = (own * own - 2 * own * (self.through @ self.caused)).sum(axis=0)
        rest = self.taken.reshape(len(self.taken), -1) @ self.total.reshape(len(self.total), -1).T
        full = self._by_pair((own * own).sum(axis=0), self.roots)
        return self._by_pair(left, self.roots) + rest, np.diag(full)

    def means(self, covariances: np.ndarray) -> np.ndarray:
        """Return the part (blocks, J) of each point in the mean of Q; covariances (J, p, p)."""
        moved = covariances @ self.weight
        own = (moved * self.weight).sum(axis=1)
        cross = (np.swapaxes(moved, 1, 2) * self.through).sum(axis=2)
        taken = self.taken.reshape(len(self.taken), -1) @ covariances.reshape(len(moved), -1).T
        return np.asarray(np.add.reduceat((own - 2 * cross).T, self.probes) + taken)

    def spread(self, left: np.ndarray, colour: np.ndarray, caused: np.ndarray) -> np.ndarray:
        """Return the covariance (blocks, blocks) of Q of normal scores.

        Their covariance, for the pair of blocks i and k, is colour_i colour_k left + caused, (J, p,
        p) each.
        """
        halves = zip(self._covariances(left), self._covariances(caused), strict=True)
        found = []
        for block, (of_left, of_caused) in enumerate(halves):
            factor = np.repeat(colour[block] * colour, self.ranks)
            squares = (factor * of_left + of_caused) ** 2
            found.append(2 * np.add.reduceat(squares.sum(axis=(0, 1, 2)), self.probes))
        return np.array(found)

    def _covariances(self, of_scores: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the covariance (J, r, J, R) of each block's weighted scores with those of all."""
        count, rank = self.through.shape[:2]
        flat = self.through.reshape(count * rank, -1)
        moved = of_scores @ self.weight
        flat_moved = np.swapaxes(moved, 1, 2).reshape(count * rank, -1)
        taken = flat @ of_scores.sum(axis=0)
        every = np.arange(count)
        for first, size in zip(self.probes, self.ranks, strict=True):
            here = slice(first, first + size)
            both = taken.reshape(count, rank, -1)[:, here] - np.swapaxes(moved, 1, 2)[:, here]
            full = both.reshape(count * size, -1) @ flat.T
            full -= self.through[:, here].reshape(count * size, -1) @ flat_moved.T
            full = full.reshape(count, size, count, rank)
            full[every, :, every] += np.swapaxes(moved, 1, 2)[:, here] @ self.weight
            yield full

    def _by_pair(self, columns: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Sum (R, R') over the columns of each pair of blocks."""
        return np.asarray(np.add.reduceat(np.add.reduceat(columns, self.probes), others, axis=1))


def _firsts(sizes: Iterable[int]) -> np.ndarray:
    """Return where each of several blocks in a row begins."""
    return np.cumsum([0, *sizes])[:-1]


def _weight(points: PointScores, probe: np.ndarray, variance: float) -> np.ndarray:
    """Return the weights (J, p, r) by which deviations of some parameters are looked for."""
    seen = probe.T @ points.left @ probe
    seen = (seen + np.swapaxes(seen, 1, 2)) / 2
    values, vectors = np.linalg.eigh(seen + variance * seen @ seen)
    least = 1e-9 * np.maximum(values[:, -1:], 1e-290)
    scale = np.where(values > least, 1 / np.sqrt(np.maximum(values, least)), 0.0)
    return np.asarray(probe @ (vectors * scale[:, None, :]))
