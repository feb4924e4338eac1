"""Weighted least squares of lines at the orders of the turn, with errors by how turns differ.

With lines r of the operating points, columns X, noise n_j of point j, what the model itself is
good for, m, and priors of variance 1,

    d = (X'X)^+ X' r,    V = g (f sum_j B_j n_j^2 B_j' + B m^2 B') + prior,    B = (X'X)^+ X'

The noise n_j of an order is how the turns of the point differ there and at its neighbours, so it
may have any colour. Where turns differ more along the parameters than at the orders around them,
f > 1 is by how much (cluster-robust, a cluster is a turn); where the columns leave more than noise
and m, g > 1 is by how much. Degrees of freedom are Satterthwaite's.

Groups of turns may count with weights: sum w r / sum w has the variance

    sum w^2 |r - mean|^2 / (sum w)^2 / (1 - 1/n),    n = (sum w)^2 / sum w^2

A point whose largest weight is below 1 is as much less certain: n_j and m are divided by its root.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motord.experiments.calibration.estimate.turn_spectrum import orders_averaged, smooth_noise
from motord.identification.cluster_robust_ls import equilibrated
from motord.identification.variance_components import VarianceComponents

MODELLED_SHARE = 1e-4
"""Part of a column's largest square from which on the column is at an order."""


@dataclass(frozen=True)
class _Groups:
    """Lines (groups, orders) of the turns of a point, with weights (groups,)."""

    lines_Nm: np.ndarray
    weights: np.ndarray

    @property
    def effective(self) -> float:
        """How many groups of one weight would tell as much."""
        return float(self.weights.sum() ** 2 / (self.weights**2).sum())

    @cached_property
    def mean_Nm(self) -> np.ndarray:
        """Mean over the groups (orders,)."""
        return np.asarray(self.weights @ self.lines_Nm / self.weights.sum())

    @property
    def apart_Nm(self) -> np.ndarray:
        """What the groups differ by from their mean (groups, orders)."""
        return np.asarray(self.lines_Nm - self.mean_Nm)

    def variance_of_mean(self, apart: np.ndarray) -> np.ndarray:
        """Return the variance (n,) of the mean of values that are `apart` (groups, n) from it."""
        share = self.weights / self.weights.sum()
        return np.asarray(share**2 @ np.abs(apart) ** 2 / (1 - 1 / self.effective))


@dataclass(frozen=True)
class LineFit:
    """Lines (groups, orders) of the turns of each point; columns (points, p, orders).

    prior (k, p): rows of unit variance that are 0; model_Nm: standard deviation m of a line, or of
    those of each order (orders,);
    lowest_order: of what is looked for; weights (groups,) of each point, None for 1.
    """

    groups_Nm: Sequence[np.ndarray]
    columns: np.ndarray
    prior: np.ndarray
    model_Nm: float | np.ndarray
    lowest_order: int
    weights: Sequence[np.ndarray] | None = None

    @cached_property
    def _groups(self) -> list[_Groups]:
        weights = self.weights or [np.ones(len(lines)) for lines in self.groups_Nm]
        return [_Groups(*each) for each in zip(self.groups_Nm, weights, strict=True)]

    @cached_property
    def _doubt(self) -> np.ndarray:
        """By what the noise of each point is larger for its age (points, 1)."""
        return np.array([[one.weights.max() ** -0.5] for one in self._groups])

    @cached_property
    def _turn_Nm(self) -> np.ndarray:
        """Noise of the means over the turns (points, orders)."""
        variance = np.array([one.variance_of_mean(one.apart_Nm) for one in self._groups])
        return np.asarray(self._doubt * smooth_noise(variance))

    @cached_property
    def _weight(self) -> np.ndarray:
        """Of the lines (points, orders): a line of noise 1 has 1/2 in its real part."""
        return np.asarray(np.sqrt(2) / np.hypot(self._turn_Nm, self._doubt * self.model_Nm))

    @cached_property
    def _x(self) -> np.ndarray:
        """Columns (2, points, orders, p), weighed: real and imaginary parts."""
        lines = np.moveaxis(self.columns * self._weight[:, None, :], 1, 2)
        return np.array([lines.real, lines.imag])

    @cached_property
    def _y(self) -> np.ndarray:
        """Lines (2, points, orders), weighed."""
        lines = np.array([one.mean_Nm for one in self._groups]) * self._weight
        return np.array([lines.real, lines.imag])

    @cached_property
    def _inverse(self) -> tuple[np.ndarray, np.ndarray]:
        """The pseudo-inverse (p, p) of X'X, and the projection (p, p) on what is seen."""
        flat = self._x.reshape(-1, self._x.shape[-1])
        normal = flat.T @ flat + self.prior.T @ self.prior
        scaled, scale = equilibrated(normal)
        values, vectors = np.linalg.eigh(scaled)
        seen = vectors[:, values > 1e-10 * values[-1]]
        inverse = scale[:, None] * (seen / values[-seen.shape[1] :]) @ seen.T * scale
        return inverse, scale[:, None] * (seen @ seen.T) / scale

    @property
    def seen(self) -> np.ndarray:
        """Projection (p, p) of directions on what the lines show."""
        return np.asarray(self._inverse[1].T)

    @cached_property
    def _influence(self) -> np.ndarray:
        """B (p, 2, points, orders)."""
        return np.asarray(np.einsum("ij,cphj->icph", self._inverse[0], self._x))

    @cached_property
    def change(self) -> np.ndarray:
        """The solution d (p,)."""
        return np.asarray(np.einsum("icph,cph->i", self._influence, self._y))

    @cached_property
    def misfit(self) -> float:
        """Mean square of residuals at the columns' own orders, over what is expected."""
        residual = self._doubt * (self._y - self._x @ self.change)
        power = (np.abs(self.columns) ** 2).sum(axis=0)
        own = (power > MODELLED_SHARE * power.max(axis=1, keepdims=True)).any(axis=0)
        freedom = max(residual[:, :, own].size - len(self.change), 1)
        return float((residual[:, :, own] ** 2).sum() / freedom)

    @property
    def errors(self) -> VarianceComponents:
        """Errors of the solution."""
        random = (self._turn_Nm * self._weight) ** 2 / 2
        parts = np.einsum("icph,ph,jcph->pij", self._influence, random, self._influence)
        turns = np.array([one.effective for one in self._groups])
        averaged = orders_averaged(random.shape[1])[self.lowest_order - 1]
        more = max(self.misfit, 1.0)
        scatter = more * max(self._turn_dispersion(parts.sum(axis=0)), 1.0)
        rest = np.einsum("icph,ph,jcph->ij", self._influence, 1 - random, self._influence)
        before = self._inverse[0] @ self.prior.T
        doubt = np.diag(scatter**2 / (averaged * (turns - 1)))
        sizes, sources = np.full(len(turns), scatter), ("turns",) * len(turns)
        known = VarianceComponents.known(more * rest + before @ before.T, "model and calibration")
        return VarianceComponents(parts, sizes, doubt, sources) + known

    def _turn_dispersion(self, expected: np.ndarray) -> float:
        """Return by how much turns differ along the parameters, over the `expected` (p, p)."""
        found = np.zeros(len(expected))
        for point, groups in enumerate(self._groups):
            along = (self._influence[:, 0, point] - 1j * self._influence[:, 1, point]) @ (
                groups.apart_Nm * self._weight[point]
            ).T
            found += self._doubt[point] ** 2 * groups.variance_of_mean(along.real.T)
        variance = np.diag(expected)
        return float((found / np.maximum(variance, 1e-300))[variance > 0].mean())
