"""Least squares in two steps: first what coast-downs have in common, then their friction.

Friction differs from coast-down to coast-down; a column x of cogging torque, fitted next to a
friction that all share, would take some of that, and the angle that follows from the fit would be
off by milliradians. So the common columns are fitted next to Coulomb and viscous friction of each
coast-down its own, and then F and b, one of each for all, to the values less these columns:

    c = (Z' Z)^-1 Z' y,    beta = (X' X)^-1 X' (y - C c)

X: columns of F and b, C: the common ones, Z: residuals of C on X of each coast-down, which thus
is partialled out (Frisch, Waugh and Lovell). What friction differs by does not move c, and the
sensitivity of beta to c is M = -(X' X)^-1 X' C. So what a coast-down has for an influence b on c,
and a on the second fit, is T (a, b), T = (I, M; 0, I); the covariance is the sum of the squares of
that over the coast-downs: errors may be correlated within one in any way.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motord.identification.cluster_robust_ls import (
    LEAST_TURNS,
    BiasReducedFit,
    ClusterFit,
    Regressors,
    satterthwaite,
    split,
)

OWN = 2
"""Columns that each coast-down has of its own: Coulomb and viscous friction."""

COLLINEAR = 3e-8
"""What is left of columns scaled to 1, below which it is rounding: the root of what
`numpy.linalg.pinv` takes for 0 in normal equations."""


@dataclass(frozen=True)
class OwnFriction:
    """Coulomb and viscous friction of each coast-down, which several fits have alike.

    columns (n, 2): of both; first (g,): the first row of each coast-down.
    """

    columns: np.ndarray
    first: np.ndarray

    @cached_property
    def regressors(self) -> Regressors:
        """The columns, of friction that the coast-downs have in common."""
        return Regressors.of(self.columns, self.first)

    @cached_property
    def _bases(self) -> list[np.ndarray]:
        return bases(self.columns, self.first)

    def partialled_out(self, columns: np.ndarray) -> np.ndarray:
        """Return residuals of columns (n,) or (n, p) on each coast-down's own friction."""
        return partialled_out(self._bases, columns, self.first)


@dataclass(frozen=True)
class TwoStepFit:
    """solution (p,): Coulomb and viscous friction, then the common columns' coefficients.

    residual (n,); sensitivity: T (p, p), to both steps; common: the first, its residual that with
    friction of each coast-down its own; friction: the second.
    """

    solution: np.ndarray
    residual: np.ndarray
    sensitivity: np.ndarray
    friction: ClusterFit | BiasReducedFit
    common: ClusterFit | BiasReducedFit
    own: OwnFriction

    @classmethod
    def of(cls, columns: np.ndarray, first: np.ndarray, values: np.ndarray) -> "TwoStepFit":
        """Fit values (n,) by columns (n, p); first (g,): the first row of each coast-down."""
        return cls.with_common(OwnFriction(columns[:, :OWN], first), columns[:, OWN:], values)

    @classmethod
    def with_common(cls, own: OwnFriction, more: np.ndarray, values: np.ndarray) -> "TwoStepFit":
        """Fit values (n,) by own friction and by columns (n, p - 2) that all have in common."""
        free, free_values = own.partialled_out(more), own.partialled_out(values)
        common = _cluster_robust(Regressors.of(free, own.first), free_values)
        friction = _cluster_robust(own.regressors, values - more @ common.solution)
        sensitivity = np.eye(OWN + more.shape[1])
        sensitivity[:OWN, OWN:] = -own.regressors.inverse @ (own.columns.T @ more)
        solution = np.concatenate([friction.solution, common.solution])
        return cls(solution, friction.residual, sensitivity, friction, common, own)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance (p, p) of both steps; of few coast-downs, that of white noise."""
        friction, common = self.friction, self.common
        cross = np.zeros((OWN, common.solution.size))
        if isinstance(friction, BiasReducedFit) and isinstance(common, BiasReducedFit):
            cross = friction.influence @ common.influence.T
        steps = np.block([[friction.covariance, cross], [cross.T, common.covariance]])
        return np.asarray(self.sensitivity @ steps @ self.sensitivity.T)

    def freedom(self, contrast: np.ndarray) -> float:
        """Return the degrees of freedom of contrast (p,) times the solution.

        Satterthwaite's of both steps, at most one less than coast-downs.
        """
        most, friction, common = float(self.own.first.size - 1), self.friction, self.common
        if not (isinstance(friction, BiasReducedFit) and isinstance(common, BiasReducedFit)):
            return most
        own, shared = np.split(self.sensitivity.T @ contrast, [OWN])
        form = friction.quadratic_form(own) + common.quadratic_form(shared)
        singleton = friction.singleton_variance(own) + common.singleton_variance(shared)
        return min(satterthwaite(form, singleton, self.residual.size - self.solution.size), most)


def bases(own: np.ndarray, first: np.ndarray) -> list[np.ndarray]:
    """Return orthonormal columns that span each coast-down's own columns.

    first (g,): the first row of each coast-down.
    """
    return [np.linalg.qr(x)[0] for x in split(own, first)]


def orthonormal(left: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (n, k) of what is left of columns (n, p) by others.

    What is collinear with those, or with each other, is rounding, and is none.
    """
    scaled = left / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    if scaled.shape[1] == 1:  # of which the decomposition takes eight times as long
        size = np.linalg.norm(scaled)
        return np.asarray(scaled[:, :0] if size <= COLLINEAR else scaled / size)
    base, singular, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(base[:, singular > COLLINEAR])


def partialled_out(own: Sequence[np.ndarray], columns: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Return residuals of columns (n,) or (n, p) on each coast-down's own columns.

    own: their `bases`.
    """
    pairs = zip(own, split(columns, first), strict=True)
    return np.concatenate([y - q @ (q.T @ y) for q, y in pairs])


def _cluster_robust(regressors: Regressors, values: np.ndarray) -> ClusterFit | BiasReducedFit:
    """Return the fit with the covariance of how the coast-downs differ alone, if they are enough.

    That of white noise is no lower limit for it: the encoder's rounding changes from sample to
    sample, and moves a fit of smooth columns less.
    """
    if regressors.first.size < LEAST_TURNS:
        return regressors.fit(values)
    return regressors.fit_bias_reduced(values)
