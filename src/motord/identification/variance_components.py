"""Variance components: a covariance that is a sum of parts, each known to its own accuracy.

    V = sum_i s_i V_i,   freedom(c) = 2 (c' V c)^2 / var,   var = x' cov(s) x,   x_i = c' V_i c

An interval is c'theta +- t(freedom) sqrt(c' V c). Satterthwaite 1946; Giesbrecht and Burns 1985.
"""

from dataclasses import dataclass

import numpy as np

MOST_FREEDOM = 1e6
"""Degrees of freedom that are given where a variance is as good as known."""


@dataclass(frozen=True)
class VarianceComponents:
    """parts (m, k, k) of the covariance; their sizes (m,) and the covariance of these (m, m).

    sources (m,): what each part comes from.
    """

    parts: np.ndarray
    sizes: np.ndarray
    size_covariance: np.ndarray
    sources: tuple[str, ...]

    @classmethod
    def known(cls, covariance: np.ndarray, source: str) -> "VarianceComponents":
        """Return a covariance (k, k) that is not in doubt."""
        return cls(covariance[None], np.ones(1), np.zeros((1, 1)), (source,))

    def __add__(self, other: "VarianceComponents") -> "VarianceComponents":
        """Return the sum of two covariances whose sizes are independent of each other."""
        here = self.sizes.size
        both = np.zeros(2 * (here + other.sizes.size,))
        both[:here, :here], both[here:, here:] = self.size_covariance, other.size_covariance
        return VarianceComponents(
            np.concatenate([self.parts, other.parts]),
            np.concatenate([self.sizes, other.sizes]),
            both,
            (*self.sources, *other.sources),
        )

    def of(self, source: str) -> np.ndarray:
        """Return the covariance (k, k) that comes from a source."""
        here = np.array([name == source for name in self.sources])
        return np.asarray(np.einsum("m,mij->ij", self.sizes[here], self.parts[here]))

    @property
    def covariance(self) -> np.ndarray:
        """The covariance (k, k)."""
        return np.asarray(np.einsum("m,mij->ij", self.sizes, self.parts))

    @property
    def stderr(self) -> np.ndarray:
        """Standard errors (k,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0)))

    @property
    def freedom(self) -> np.ndarray:
        """Effective degrees of freedom of each standard error (k,)."""
        return self._freedom(np.diagonal(self.parts, axis1=1, axis2=2))

    def along(self, contrast: np.ndarray) -> tuple[float, float]:
        """Return the standard error of contrast (k,) times the parameters, and its freedom."""
        variance, freedom = self.trace(np.outer(contrast, contrast))
        return float(np.sqrt(max(variance, 0.0))), freedom

    def trace(self, form: np.ndarray) -> tuple[float, float]:
        """Return the mean of a quadratic form (k, k) of the errors, and its freedom."""
        shares = np.einsum("ij,mji->m", form, self.parts)
        return float(self.sizes @ shares), float(self._freedom(shares[:, None])[0])

    def _freedom(self, shares: np.ndarray) -> np.ndarray:
        """Return the degrees of freedom of variances with shares (m, n) in the parts (n,)."""
        variance = self.sizes @ shares
        doubt = np.einsum("mn,ml,ln->n", shares, self.size_covariance, shares)
        least = 2 * variance**2 / MOST_FREEDOM
        return np.asarray(np.maximum(2 * variance**2 / np.maximum(doubt, least + 1e-300), 1.0))
