"""Least squares in two steps: first what coast-downs have in common, then their friction.

Friction differs from coast-down to coast-down; a column x of cogging torque, fitted next to a
friction that all share, would take some of that, and the angle that follows from the fit would be
off by milliradians. So the common columns are fitted next to Coulomb and viscous friction of each
coast-down its own, and then F and b, one of each for all, to what the common columns leave:

    c = (Z' Z)^-1 Z' y,    beta = (X' X)^-1 X' (y - C c)

X: columns of F and b, C: the common ones, Z: what is left of C beyond X of each coast-down. What
friction differs by does not move c, and c moves beta by M = -(X' X)^-1 X' C:

    cov beta = cov of (y - C c on X) + M cov(c) M',    cov(beta, c) = M cov(c)
"""

from dataclasses import dataclass

import numpy as np

from motord.identification.cluster_robust_ls import (
    LEAST_TURNS,
    BiasReducedFit,
    ClusterFit,
    Regressors,
)

OWN = 2
"""Columns that each coast-down has of its own: Coulomb and viscous friction."""


@dataclass(frozen=True)
class TwoStepFit(ClusterFit):
    """solution (p,): Coulomb and viscous friction, then the common columns' coefficients.

    own_rest (n,): what is left of the values with friction of each coast-down its own; through:
    M (2, p - 2); friction, common: both steps.
    """

    own_rest: np.ndarray
    through: np.ndarray
    friction: ClusterFit
    common: ClusterFit
    clusters: int

    @classmethod
    def of(cls, columns: np.ndarray, cluster: np.ndarray, values: np.ndarray) -> "TwoStepFit":
        """Fit values (n,) by columns (n, p); cluster (n,): number of each sample's coast-down."""
        own, more = columns[:, :OWN], columns[:, OWN:]
        regressors = Regressors.of(own, cluster)
        free, free_values = beyond_own(own, more, values, regressors.first)
        common = _cluster_robust(Regressors.of(free, cluster), free_values)
        friction = _cluster_robust(regressors, values - more @ common.solution)
        through = -regressors.inverse @ (own.T @ more)
        moved = through @ common.covariance
        covariance = np.block(
            [[friction.covariance + moved @ through.T, moved], [moved.T, common.covariance]]
        )
        solution = np.concatenate([friction.solution, common.solution])
        return cls(
            solution, covariance, friction.rest, friction.noise,
            common.rest, through, friction, common, regressors.first.size,
        )  # fmt: skip

    def freedom(self, contrast: np.ndarray) -> float:
        """Return the degrees of freedom of contrast (p,) times the solution.

        Those of both steps by Welch and Satterthwaite, at most one less than coast-downs.
        """
        most = float(self.clusters - 1)
        first = contrast[OWN:] + self.through.T @ contrast[:OWN]
        total = squares = 0.0
        for fit, weights in ((self.friction, contrast[:OWN]), (self.common, first)):
            variance = float(weights @ fit.covariance @ weights)
            if variance > 0:
                of_fit = fit.freedom(weights) if isinstance(fit, BiasReducedFit) else most
                total, squares = total + variance, squares + variance**2 / of_fit
        return min(total**2 / squares, most) if squares else most


def beyond_own(
    own: np.ndarray, common: np.ndarray, values: np.ndarray, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return what each coast-down's own columns do not explain of the others and of the values.

    first (g,): the first row of each coast-down.
    """
    left = []
    for rows in np.split(np.arange(values.size), first[1:]):
        q = np.linalg.qr(own[rows])[0]
        both = np.column_stack([common[rows], values[rows]])
        left.append(both - q @ (q.T @ both))
    every = np.concatenate(left)
    return every[:, :-1], every[:, -1]


def _cluster_robust(regressors: Regressors, values: np.ndarray) -> ClusterFit:
    """Return the fit with the covariance of how the coast-downs differ alone, if they are enough.

    That of white noise is no lower limit for it: the encoder's rounding changes from sample to
    sample, and moves a fit of smooth columns less.
    """
    if regressors.first.size < LEAST_TURNS:
        return regressors.fit(values)
    return regressors.fit_bias_reduced(values)
