"""Least squares with cluster-robust (sandwich) covariance; a cluster is one turn.

    beta = (X' X)^-1 X' y,    cov = (X' X)^-1 (sum_g X_g' e_g e_g' X_g) (X' X)^-1 G / (G - 1)

Errors may be correlated in any way within a turn, not between turns.

Where the leverages H_g = X_g (X' X)^-1 X_g' of few clusters differ, that is too small: residuals
e_g of a cluster are the smaller the more it weighs. `BiasReducedFit` takes (I - H_g)^-1/2 e_g in
their place (bias-reduced linearisation, CR2), with Satterthwaite's degrees of freedom (Bell and
McCaffrey 2002). Both follow from a working model, errors that are independent. A singleton
direction, which one cluster alone determines, has no residual: its variance is that of white noise.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

LEAST_TURNS = 6
"""Turns from which on the spread between turns estimates the noise, not that of samples."""

FEWEST_TURNS = 3
"""The same where the errors of several speeds, each of few turns, are taken together: the larger of
both counts, which white noise makes a little too wide, and coloured noise does not make narrow."""

SINGLETON_LIMIT = 1e-8
"""1 less the leverage of a cluster in a direction, below which that is a singleton: the residual is
zero there and says nothing of the errors, which are taken for white noise."""

ONE_PRODUCT = ["einsum_path", (0, 1)]
"""For np.einsum of two arrays as a product of matrices, which is no search for the best order."""


def equilibrated(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a symmetric matrix scaled to a unit diagonal, S N S (p, p), and diag(S) (p,)."""
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return matrix * np.outer(scale, scale), scale


@dataclass(frozen=True)
class ClusterFit:
    """solution (p,), its covariance (p, p), residual (n,), standard deviation of that (noise)."""

    solution: np.ndarray
    covariance: np.ndarray
    residual: np.ndarray
    noise: float


@dataclass(frozen=True)
class BiasReduction:
    """What CR2 makes of columns: the same for all values that are fitted by them.

    parts: rows (n_g, p) of each cluster, columns times root (p, p), a root of (X' X)^-1; of these,
    leverage (g, p, p) is X_g' X_g, and adjustment (g, p, p) what (I - H_g)^-1/2 makes of them.
    singletons (m, p): singleton directions of the solution, each times the standard deviation that
    white noise of variance 1 gives it.
    """

    root: np.ndarray
    parts: list[np.ndarray]
    leverage: np.ndarray
    adjustment: np.ndarray
    singletons: np.ndarray

    @classmethod
    def of(cls, regressors: "Regressors") -> "BiasReduction":
        """Adjust the columns."""
        scale = np.sqrt(np.maximum(np.diag(regressors.inverse), 1e-300))
        sizes, vectors = np.linalg.eigh(regressors.inverse / np.outer(scale, scale))
        root = scale[:, None] * vectors * np.sqrt(np.maximum(sizes, 0.0))
        parts = [x @ root for x in split(regressors.columns, regressors.first)]
        leverage = np.array([part.T @ part for part in parts])
        shares, axes = np.linalg.eigh(leverage)
        complement = 1.0 - shares
        known = complement > SINGLETON_LIMIT
        factor = np.where(known, np.maximum(complement, SINGLETON_LIMIT) ** -0.5, 0.0)
        adjustment = np.einsum("gik,gk,gjk->gij", axes, factor, axes)
        singletons = np.swapaxes(axes, 1, 2)[~known] @ root.T
        return cls(root, parts, leverage, adjustment, singletons)


@dataclass(frozen=True)
class BiasReducedFit:
    """A fit as `ClusterFit`, but with bias-reduced cluster-robust covariance (CR2)."""

    solution: np.ndarray
    residual: np.ndarray
    noise: float
    regressors: "Regressors"

    @cached_property
    def influence(self) -> np.ndarray:
        """Influence (p, g) of each cluster on the solution, by its adjusted residuals."""
        reduction = self.regressors.bias_reduction
        pairs = zip(reduction.parts, split(self.residual, self.regressors.first), strict=True)
        scores = np.array([part.T @ e for part, e in pairs])
        return np.asarray(reduction.root @ np.einsum("gij,gj->ig", reduction.adjustment, scores))

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of the solution (p, p): of how the clusters differ alone."""
        influence, singletons = self.influence, self.regressors.bias_reduction.singletons
        return np.asarray(influence @ influence.T + self.noise**2 * singletons.T @ singletons)

    def freedom(self, contrast: np.ndarray) -> float:
        """Return Satterthwaite's degrees of freedom of contrast (p,) times the solution."""
        residual_freedom = max(self.residual.size - self.solution.size, 1)
        form, singleton = self.quadratic_form(contrast), self.singleton_variance(contrast)
        return satterthwaite(form, singleton, residual_freedom)

    def quadratic_form(self, contrast: np.ndarray) -> np.ndarray:
        """Return the covariance (g, g) of the clusters' influences for white noise of variance 1.

        The variance of contrast (p,) times the solution is their sum of squares: a quadratic form.
        """
        reduction = self.regressors.bias_reduction
        weights = reduction.adjustment @ (reduction.root.T @ contrast)
        crossed = np.einsum("gij,gj->gi", reduction.leverage, weights)
        own = np.einsum("gi,gi->g", weights, crossed)
        return np.asarray(np.diag(own) - crossed @ crossed.T)

    def singleton_variance(self, contrast: np.ndarray) -> float:
        """Return the variance by singleton directions for white noise of variance 1."""
        return float(((self.regressors.bias_reduction.singletons @ contrast) ** 2).sum())


@dataclass(frozen=True)
class Regressors:
    """Columns (n, p) that several values are fitted by; first (g,): the first row of each turn.

    inverse: (X' X)^-1. least_turns: turns from which on how they differ counts.
    """

    columns: np.ndarray
    inverse: np.ndarray
    first: np.ndarray
    least_turns: int = LEAST_TURNS

    @classmethod
    def of(
        cls, columns: np.ndarray, first: np.ndarray, least_turns: int = LEAST_TURNS
    ) -> "Regressors":
        """Prepare the columns."""
        # not columns.T @ columns, for which BLAS takes its slow way with long thin matrices
        normal = np.einsum("ni,nj->ij", columns, columns, optimize=ONE_PRODUCT)
        scaled, scale = equilibrated(normal)
        inverse = np.linalg.pinv(scaled, hermitian=True) * np.outer(scale, scale)
        return cls(columns, inverse, first, least_turns)

    def solved(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the solution (p,) of a fit of values (n,) and its residual (n,)."""
        solution = self.inverse @ (self.columns.T @ values)
        return solution, np.asarray(values - self.columns @ solution)

    def _with_noise(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the solution (p,) of values (n,), its residual (n,) and the deviation of that."""
        solution, residual = self.solved(values)
        freedom = max(residual.size - solution.size, 1)
        return solution, residual, float(np.sqrt(residual @ residual / freedom))

    def fit(self, values: np.ndarray) -> ClusterFit:
        """Fit values (n,).

        The covariance is that of white noise, or, where it is larger, the one that follows from how
        the turns differ: sum of g g' over turns, g a turn's columns times its residuals.
        """
        solution, residual, noise = self._with_noise(values)
        homoskedastic = noise**2 * self.inverse
        pairs = zip(split(self.columns, self.first), split(residual, self.first), strict=True)
        scores = np.array([x.T @ e for x, e in pairs])
        more = _inflation(self.inverse @ scores.T, np.diag(homoskedastic), self.least_turns)
        return ClusterFit(solution, homoskedastic * np.outer(more, more), residual, noise)

    def fit_bias_reduced(self, values: np.ndarray) -> BiasReducedFit:
        """Fit values (n,); the covariance is that of how the clusters differ (CR2) alone."""
        return BiasReducedFit(*self._with_noise(values), self)

    @cached_property
    def bias_reduction(self) -> BiasReduction:
        """What CR2 makes of the columns."""
        return BiasReduction.of(self)

    def one_more(self, fit: ClusterFit, column: np.ndarray) -> tuple[float, float]:
        """Return the coefficient, and its variance, that one more column (n,) would get.

        fit: of the values without it.
        """
        partial = column - self.columns @ (self.inverse @ (self.columns.T @ column))
        square = float(partial @ partial)
        coefficient = float(partial @ fit.residual) / square
        residual = fit.residual - coefficient * partial
        variance = float(residual @ residual) / max(residual.size, 1) / square
        influence = np.add.reduceat(partial * residual, self.first)[None, :] / square
        more = _inflation(influence, np.array([variance]), self.least_turns)
        return coefficient, variance * float(more[0]) ** 2


def split(values: np.ndarray, first: np.ndarray) -> list[np.ndarray]:
    """Return rows (n, ...) of each turn; first (g,): the first row of each.

    As np.split does, which takes ten times as long.
    """
    return [values[a:b] for a, b in pairwise([*first.tolist(), len(values)])]


def first_rows(number: np.ndarray) -> np.ndarray:
    """Return the first row of each turn (g,) by the number of each row's (n,), in order from 0."""
    return np.flatnonzero(np.diff(number, prepend=-1))


def satterthwaite(form: np.ndarray, singleton: float, residual_freedom: int) -> float:
    """Return the degrees of freedom of a variance: a quadratic form (g, g) of clusters and noise.

    singleton: the part by noise, whose own degrees of freedom are residual_freedom.
    """
    squares = float((form**2).sum()) + singleton**2 / residual_freedom
    return float((np.trace(form) + singleton) ** 2 / max(squares, 1e-300))


def _inflation(influence: np.ndarray, variance: np.ndarray, least_turns: int) -> np.ndarray:
    """Return factors (p,) for standard errors by white noise, of variance (p,).

    influence (p, g): of each turn.
    """
    turns = influence.shape[1]
    if turns < least_turns:
        return np.ones(influence.shape[0])
    between = (influence**2).sum(axis=1) * turns / (turns - 1)
    return np.asarray(np.sqrt(np.maximum(between / np.maximum(variance, 1e-300), 1.0)))
