"""Noise of a channel as an autoregression, by which residuals are whitened.

    e_t = sum_k a_k e_(t-k) + s w_t,    w white

Coefficients by Yule and Walker, their number by the information criterion of Akaike (1974). What
the fit has taken of the noise is put back: cov(residual) = cov(e) - J cov(fit) J'.
Each valid reading is predicted from the p valid ones before it, as far away as they are: without a
gap by the coefficients themselves, at the beginning from fewer (Vecchia 1988): a missing reading
costs only itself. Least squares of residuals that are whitened so (Cochrane and Orcutt 1949, for p
lags) have standard errors that hold for any noise that such an autoregression describes.
"""

from dataclasses import dataclass

import numpy as np

from motord.experiments.thermal.recursion import recur

ORDER_MAX = 30
"""Largest number of coefficients."""

TINY_K = 1e-6
"""Noise below which a channel counts as having none."""

LEAST_PART = 1e-12
"""Least part of its variance that predictions leave of noise."""


@dataclass(frozen=True)
class Autoregression:
    """Predictions of the valid readings (v,) of a channel, each from p before it at most.

    valid: their places among all readings. before (v, p): places of those that each is predicted
    from; coefficients (v, p): 0 where there is none; scale (v,): standard errors, K.
    """

    valid: np.ndarray
    before: np.ndarray
    coefficients: np.ndarray
    scale: np.ndarray

    @classmethod
    def white(cls, known: np.ndarray, scale: float) -> "Autoregression":
        """Return white noise; known (n,): which readings are valid."""
        valid = np.flatnonzero(known)
        none = np.zeros((valid.size, 0))
        return cls(valid, none.astype(int), none, np.full(valid.size, scale))

    @classmethod
    def of(cls, residual: np.ndarray, root: np.ndarray) -> "Autoregression":
        """Return what describes a residual (n,), nan where there is none.

        root (n, p): that of the covariance of the fit, root @ root.T.
        """
        known = np.isfinite(residual)
        covariance = _covariance(np.column_stack([residual, root]), known)
        if covariance[0] < TINY_K**2:
            return cls.white(known, TINY_K)
        return cls._predicting(np.flatnonzero(known), *_extended(covariance, known))

    @classmethod
    def _predicting(cls, valid: np.ndarray, covariance: np.ndarray, order: int) -> "Autoregression":
        """Return the best linear predictions by the covariance (n,) of each lag.

        Those of the same lags, as all between gaps are, have the same coefficients.
        """
        number = np.arange(valid.size)[:, None] - 1 - np.arange(order)
        before = valid[np.maximum(number, 0)]
        every = np.where(number >= 0, valid[:, None] - before, 0)
        begins = np.r_[True, (every[1:] != every[:-1]).any(axis=1)]  # most rows are as before
        lags, same = np.unique(every[begins], axis=0, return_inverse=True)
        same = same.ravel()[np.cumsum(begins) - 1]  # numpy 2.0 returns (m, 1)
        there = lags > 0
        both = there[:, :, None] & there[:, None, :]
        matrix = np.where(both, covariance[np.abs(lags[:, :, None] - lags[:, None, :])], 0.0)
        matrix += (~there * covariance[0])[:, :, None] * np.eye(order)
        wanted = np.where(there, covariance[lags], 0.0)
        coefficients = np.linalg.solve(matrix, wanted[:, :, None])[:, :, 0]
        left = covariance[0] - np.einsum("vp,vp->v", coefficients, wanted)
        scale = np.sqrt(np.maximum(left, LEAST_PART * covariance[0]))
        return cls(valid, before, coefficients[same], scale[same])

    def whitened(self, column: np.ndarray) -> np.ndarray:
        """Return the valid ones (v,) of a column (n,), whitened."""
        predicted = np.einsum("vp,vp->v", self.coefficients, column[self.before])
        return np.asarray((column[self.valid] - predicted) / self.scale)


def _covariance(columns: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the covariance of each lag, of pairs that are both valid, as without gaps."""
    columns, size = np.where(known[:, None], columns, 0.0), known.size
    found = []
    for lag in range(min(ORDER_MAX, int(known.sum()) // 10) + 1):
        pairs = np.count_nonzero(known[lag:] & known[: size - lag])
        if not pairs:
            break
        mean = np.vdot(columns[lag:], columns[: size - lag]) / pairs
        found.append(mean * (1 - lag / size))
    return np.array(found)


def _extended(covariance: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the covariance of every lag (n,) by the best autoregression, and its order.

    Coefficients of each order follow from those of the one before (Levinson and Durbin).
    """
    number, best, left = np.count_nonzero(known), np.inf, 1.0
    a = trial = np.zeros(0)
    for order in range(covariance.size):
        if order:
            unexplained = covariance[order] - trial @ covariance[order - 1 : 0 : -1]
            last = unexplained / (left * covariance[0])
            trial = np.append(trial - last * trial[::-1], last)
            left *= 1 - last**2
        if not LEAST_PART < left <= 1.0:
            break  # of scattered pairs it need not be the covariance of anything
        score = float(number * np.log(left) + 2 * order)
        if score < best:
            best, a = score, trial
    # r_k = sum_j a_j r_(k-j): an impulse response that begins with what is known
    start = covariance[: max(a.size, 1)]
    fed = np.zeros(known.size)
    fed[: start.size] = np.convolve(start, np.concatenate([[1.0], -a]))[: start.size]
    recur(fed, a)
    return fed, a.size
