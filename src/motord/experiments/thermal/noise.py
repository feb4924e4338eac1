"""Noise of a channel as an autoregression, by which residuals are whitened.

    e_t = sum_k a_k e_(t-k) + s w_t,    w white

Coefficients by Yule and Walker, their number by the information criterion of Akaike (1974). What
the fit has taken of the noise is put back: cov(residual) = cov(e) - J cov(fit) J'.
Least squares of whitened residuals (Cochrane and Orcutt 1949, for p lags) have standard errors that
hold for any noise that such an autoregression describes.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz

ORDER_MAX = 30
"""Largest number of coefficients."""

TINY_K = 1e-6
"""Noise below which a channel counts as having none."""


@dataclass(frozen=True)
class Autoregression:
    """Coefficients a (p,) and the standard deviation of what they leave."""

    coefficients: np.ndarray
    scale: float

    @classmethod
    def white(cls, scale: float) -> "Autoregression":
        """Return white noise."""
        return cls(np.zeros(0), scale)

    @classmethod
    def of(cls, residual: np.ndarray, taken: np.ndarray) -> "Autoregression":
        """Return what describes a residual (n,), nan where there is none.

        taken (n, p): root of the covariance of the fit, taken @ taken.T.
        """
        known = np.isfinite(residual)
        number = int(known.sum())
        columns = np.where(known[:, None], np.column_stack([residual, taken]), 0.0)
        covariance = np.array(
            [
                np.vdot(columns[lag:], columns[: known.size - lag]) / number
                for lag in range(min(ORDER_MAX, number // 10) + 1)
            ]
        )
        if covariance[0] < TINY_K**2:
            return cls.white(TINY_K)
        best = cls.white(float(np.sqrt(covariance[0])))
        least = number * np.log(covariance[0])
        for order in range(1, covariance.size):
            a = solve_toeplitz(covariance[:order], covariance[1 : order + 1])
            left = float(covariance[0] - a @ covariance[1 : order + 1])
            score = number * np.log(max(left, 1e-300)) + 2 * order
            if left > 0 and score < least:
                best, least = cls(a, float(np.sqrt(left))), score
        return best

    def whitened(self, columns: np.ndarray) -> np.ndarray:
        """Return columns (n, m) whitened (n, m); nan at the beginning and after every gap."""
        order = self.coefficients.size
        found = columns.astype(float)
        found[order:] = columns[order:]
        for lag, coefficient in enumerate(self.coefficients, start=1):
            found[order:] -= coefficient * columns[order - lag : columns.shape[0] - lag]
        found[:order] = np.nan
        return found / self.scale

    @property
    def correlation_readings(self) -> float:
        """Readings over which the noise is correlated: by what the variance of a mean is larger."""
        return float((1.0 - self.coefficients.sum()) ** -2) if self.coefficients.size else 1.0
