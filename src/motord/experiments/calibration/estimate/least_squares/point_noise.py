"""Scores of operating points and the covariance of their noise, by how turns differ."""

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
    turns that happen to be alike do not make errors small.
    """
    freedom = np.maximum(turns - 1, 0)
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
    return shrunk, 2 * (np.diag(own**2 / np.maximum(freedom, 1)) + common)
