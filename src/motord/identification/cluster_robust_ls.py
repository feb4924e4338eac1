"""Least squares with cluster-robust (sandwich) covariance; a cluster is one turn.

    beta = (X' X)^-1 X' y,    cov = (X' X)^-1 (sum_g X_g' e_g e_g' X_g) (X' X)^-1 G / (G - 1)

Errors may be correlated in any way within a turn, not between turns.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

LEAST_TURNS = 6
"""Turns from which on the spread between turns estimates the noise, not that of samples."""

FEWEST_TURNS = 3
"""The same where the errors of several speeds, each of few turns, are taken together: the larger of
both counts, which white noise makes a little too wide, and coloured noise does not make narrow."""


@dataclass(frozen=True)
class ClusterFit:
    """solution (p,), covariance (p, p), what it leaves of the values (n,), its noise (1 sample)."""

    solution: np.ndarray
    covariance: np.ndarray
    rest: np.ndarray
    noise: float


@dataclass(frozen=True)
class Regressors:
    """Columns (n, p) that several values are fitted by; turn (n,): number of each sample's turn.

    The numbers run from 0 without a gap, in order. least_turns: turns from which on how they differ
    counts.
    """

    columns: np.ndarray
    inverse: np.ndarray
    first: np.ndarray
    least_turns: int = LEAST_TURNS

    @classmethod
    def of(
        cls, columns: np.ndarray, turn: np.ndarray, least_turns: int = LEAST_TURNS
    ) -> "Regressors":
        """Prepare the columns."""
        # not columns.T @ columns, for which BLAS takes its slow way with long thin matrices
        normal = np.einsum("ni,nj->ij", columns, columns, optimize=True)
        scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        scaled = np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True)
        inverse = scaled * np.outer(scale, scale)
        return cls(columns, inverse, np.flatnonzero(np.diff(turn, prepend=-1)), least_turns)

    def fit(self, values: np.ndarray) -> ClusterFit:
        """Fit values (n,).

        The covariance is that of white noise, or, where it is larger, the one that follows from how
        the turns differ: sum of g g' over turns, g a turn's columns times what the fit leaves.
        """
        solution = self.inverse @ (self.columns.T @ values)
        rest = values - self.columns @ solution
        noise = float(np.sqrt(rest @ rest / max(rest.size - solution.size, 1)))
        white = noise**2 * self.inverse
        edges = np.append(self.first, rest.size)
        scores = np.array([self.columns[a:b].T @ rest[a:b] for a, b in pairwise(edges)])
        more = _inflation(self.inverse @ scores.T, np.diag(white), self.least_turns)
        return ClusterFit(solution, white * np.outer(more, more), rest, noise)

    def one_more(self, fit: ClusterFit, column: np.ndarray) -> tuple[float, float]:
        """Return the coefficient, and its variance, that one more column (n,) would get.

        fit: of the values without it.
        """
        alone = column - self.columns @ (self.inverse @ (self.columns.T @ column))
        square = float(alone @ alone)
        coefficient = float(alone @ fit.rest) / square
        rest = fit.rest - coefficient * alone
        white = float(rest @ rest) / max(rest.size, 1) / square
        influence = np.add.reduceat(alone * rest, self.first)[None, :] / square
        return coefficient, white * float(
            _inflation(influence, np.array([white]), self.least_turns)[0]
        ) ** 2


def _inflation(influence: np.ndarray, white: np.ndarray, least_turns: int) -> np.ndarray:
    """Return by how much the turns, influence (p, b) of each, make white errors larger (p,)."""
    turns = influence.shape[1]
    if turns < least_turns:
        return np.ones(influence.shape[0])
    between = (influence**2).sum(axis=1) * turns / (turns - 1)
    return np.asarray(np.sqrt(np.maximum(between / np.maximum(white, 1e-300), 1.0)))
