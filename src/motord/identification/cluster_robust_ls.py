"""Least squares with cluster-robust (sandwich) covariance; a cluster is one turn.

    beta = (X' X)^-1 X' y,    cov = (X' X)^-1 (sum_g X_g' e_g e_g' X_g) (X' X)^-1 G / (G - 1)

Errors may be correlated in any way within a turn, not between turns.

Where the leverages H_g = X_g (X' X)^-1 X_g' of few clusters differ, that is too small: what is left
of a cluster, e_g, is the smaller the more the cluster weighs. `BiasReducedFit` takes
(I - H_g)^-1/2 e_g in its place (bias-reduced linearisation, CR2), with Satterthwaite's degrees of
freedom (Bell and McCaffrey 2002). Both follow from a working model, errors that are independent.
What one cluster alone determines leaves nothing; it has the variance of white noise.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

LEAST_TURNS = 6
"""Turns from which on the spread between turns estimates the noise, not that of samples."""

FEWEST_TURNS = 3
"""The same where the errors of several speeds, each of few turns, are taken together: the larger of
both counts, which white noise makes a little too wide, and coloured noise does not make narrow."""

LEAST_LEFT = 1e-8
"""Share of a column that other clusters determine, below which a cluster alone determines it: what
the fit leaves there is nothing and says nothing of the errors, which are taken for white noise."""


@dataclass(frozen=True)
class ClusterFit:
    """solution (p,), covariance (p, p), what it leaves of the values (n,), its noise (1 sample)."""

    solution: np.ndarray
    covariance: np.ndarray
    rest: np.ndarray
    noise: float


@dataclass(frozen=True)
class BiasReducedFit(ClusterFit):
    """A fit with bias-reduced cluster-robust covariance (CR2).

    Columns are times root (p, p), a root of (X' X)^-1; of these, leverage (g, p, p) is X_g' X_g,
    and adjustment (g, p, p) what (I - H_g)^-1/2 makes of them. alone (m, p): directions of the
    solution that one cluster alone determines, as far as white noise moves them. influence (p, g):
    by how much each cluster moves the solution, as what the fit leaves shows.
    """

    root: np.ndarray
    leverage: np.ndarray
    adjustment: np.ndarray
    alone: np.ndarray
    influence: np.ndarray

    def freedom(self, contrast: np.ndarray) -> float:
        """Return Satterthwaite's degrees of freedom of contrast (p,) times the solution."""
        of_noise = max(self.rest.size - self.solution.size, 1)
        return satterthwaite(self.form(contrast), self.white(contrast), of_noise)

    def form(self, contrast: np.ndarray) -> np.ndarray:
        """Return what independent errors of variance 1 make of the clusters' influences (g, g)."""
        weights = self.adjustment @ (self.root.T @ contrast)
        crossed = np.einsum("gij,gj->gi", self.leverage, weights)
        own = np.einsum("gi,gi->g", weights, crossed)
        return np.asarray(np.diag(own) - crossed @ crossed.T)

    def white(self, contrast: np.ndarray) -> float:
        """Return what they make of what one cluster alone determines."""
        return float(((self.alone @ contrast) ** 2).sum())


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

    def fit_bias_reduced(self, values: np.ndarray) -> BiasReducedFit:
        """Fit values (n,); the covariance is that of how the clusters differ (CR2) alone."""
        fit = self.fit(values)
        scale = np.sqrt(np.maximum(np.diag(self.inverse), 1e-300))
        sizes, vectors = np.linalg.eigh(self.inverse / np.outer(scale, scale))
        root = scale[:, None] * vectors * np.sqrt(np.maximum(sizes, 0.0))
        edges = list(pairwise([*self.first, fit.rest.size]))
        parts = [self.columns[a:b] @ root for a, b in edges]
        leverage = np.array([part.T @ part for part in parts])
        shares, axes = np.linalg.eigh(leverage)
        left = 1.0 - shares
        known = left > LEAST_LEFT
        factor = np.where(known, np.maximum(left, LEAST_LEFT) ** -0.5, 0.0)
        adjustment = np.einsum("gik,gk,gjk->gij", axes, factor, axes)
        scores = [part.T @ fit.rest[a:b] for part, (a, b) in zip(parts, edges, strict=True)]
        influence = root @ np.einsum("gij,gj->ig", adjustment, np.array(scores))
        alone = np.swapaxes(axes, 1, 2)[~known] @ root.T
        covariance = influence @ influence.T + fit.noise**2 * alone.T @ alone
        return BiasReducedFit(
            *(fit.solution, covariance, fit.rest, fit.noise),
            *(root, leverage, adjustment, alone, influence),
        )

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


def satterthwaite(form: np.ndarray, white: float, of_noise: int) -> float:
    """Return the degrees of freedom of a variance by clusters, form (g, g), and by noise.

    white: the part by noise, whose own are of_noise.
    """
    squares = float((form**2).sum()) + white**2 / of_noise
    return float((np.trace(form) + white) ** 2 / max(squares, 1e-300))


def _inflation(influence: np.ndarray, white: np.ndarray, least_turns: int) -> np.ndarray:
    """Return by how much the turns, influence (p, b) of each, make white errors larger (p,)."""
    turns = influence.shape[1]
    if turns < least_turns:
        return np.ones(influence.shape[0])
    between = (influence**2).sum(axis=1) * turns / (turns - 1)
    return np.asarray(np.sqrt(np.maximum(between / np.maximum(white, 1e-300), 1.0)))
