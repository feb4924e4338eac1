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
    """Predictions from the 0, 1, ..., p readings before: coefficients of each (k,), and its error.

    Readings at the beginning have fewer before them; without them the temperatures at the beginning
    would hardly be known.
    """

    predictions: tuple[tuple[np.ndarray, float], ...]

    @classmethod
    def white(cls, scale: float) -> "Autoregression":
        """Return white noise."""
        return cls(((np.zeros(0), scale),))

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
        found = [_prediction(covariance, order) for order in range(covariance.size)]
        scores = [2 * number * np.log(scale) + 2 * a.size for a, scale in found]
        return cls(tuple(found[: int(np.argmin(scores)) + 1]))

    @property
    def coefficients(self) -> np.ndarray:
        """Coefficients a (p,)."""
        return self.predictions[-1][0]

    def whitened(self, columns: np.ndarray) -> np.ndarray:
        """Return columns (n, m) whitened (n, m); nan after every gap."""
        found = np.empty_like(columns)
        for row, (coefficients, scale) in enumerate(self.predictions):
            before = columns[:row][::-1]
            found[row] = (columns[row] - coefficients @ before) / scale
        order, scale = row, self.predictions[-1][1]
        rest = columns[order:].copy()
        for lag, coefficient in enumerate(self.coefficients, start=1):
            rest -= coefficient * columns[order - lag : columns.shape[0] - lag]
        found[order:] = rest / scale
        return found


def _prediction(covariance: np.ndarray, order: int) -> tuple[np.ndarray, float]:
    """Return the coefficients (order,) of the best prediction, and its error."""
    if not order:
        return np.zeros(0), float(np.sqrt(covariance[0]))
    wanted = covariance[1 : order + 1]
    a = solve_toeplitz(covariance[:order], wanted)
    return a, float(np.sqrt(max(covariance[0] - a @ wanted, 1e-12 * covariance[0])))
