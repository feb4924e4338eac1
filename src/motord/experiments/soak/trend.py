"""The slope of a series over time with an interval that holds for autocorrelated residuals.

    y = a + b t + e,   e[i] = r e[i - 1] + sqrt(1 - r^2) w[i],   r = rho^max(dt[i] / median dt, 1)

w is white: a first-order autoregression in continuous time (Jones 1981), so that a gap is one. For
each rho of a grid a and b by generalised least squares (Prais and Winsten 1954), weighted by
the restricted likelihood of rho (Harville 1974) times a prior, so that rho's own uncertainty is in
the variance: that within, and that of the slopes between. Degrees of freedom: n - 2. The p-value is
that of the mixture of t distributions over rho, whose tails are wider than those of one t.
The least difference q of two values, which may be their resolution, adds q^2 / 12 of variance for
each run of the same number, which has one rounding error throughout.
Not that of `thermal.steadiness`, which takes rho as known: of 8 values at 0.5 it claims 14 % wrong.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.special import stdtr

from motord.intervals import coverage_factor

LEAST = 6
"""Values that a slope's interval needs."""

CORRELATIONS = np.linspace(0.0, 0.98, 50)
"""Of one residual with the next; drift and slower wandering cannot be told apart beyond them."""


CORRELATION_MAX = 0.8
"""Up to which intervals and claims are kept (`tests.campaigns.soak`); beyond they are too bold."""

PRIOR = (1 - CORRELATIONS**2) ** -0.75
"""Of the correlations. Jeffreys' has the power -1/2, which claims too much of 6 to 8 values."""

ROUNDING = 1e-12
"""Scatter in parts of the largest value that is none."""


@dataclass(frozen=True)
class DriftSlope:
    """Slope with its standard error, half of its 95 % interval, and p-value of no drift at all.

    None but for the slope of too few values, and of values that are all the same. correlation: of
    one residual with the next.
    """

    value: float
    stderr: float | None = None
    half_width: float | None = None
    p_value: float | None = None
    correlation: float | None = None


def slope(
    t: np.ndarray, y: np.ndarray, step: int | None = None, counts: bool = False
) -> DriftSlope:
    """Return the slope of y (n,) over t (n,), n >= 2, t rising, all finite.

    step: place of the first value after a step, whose size is fitted, too. Of values that are all
    the same there is no interval, as what hides below their resolution is not known; of counts,
    which are exact, there is.
    """
    scale = float(np.abs(y).max()) or 1.0
    t, y, n = t - t.mean(), y / scale, y.size
    y = y - y.mean()
    plain = float(t @ y / (t @ t))
    if np.abs(y).max() <= ROUNDING:
        return DriftSlope(0.0, 0.0, 0.0, 1.0, 0.0) if counts and n >= LEAST else DriftSlope(0.0)
    if n < LEAST:
        return DriftSlope(plain * scale)
    model = line_with_step(t, step)
    freedom = n - model.shape[1]
    likelihoods, slopes, variances = _by_correlation(t, model, y)
    variances += rounding_variance(model, y, 1)
    weights = PRIOR * np.exp(likelihoods - likelihoods.max())
    weights /= weights.sum()
    value = float(weights @ slopes)
    stderr = sqrt(weights @ (variances + (slopes - value) ** 2))
    ratios = slopes / np.sqrt(variances)
    p_value = min(2 * float(weights @ stdtr(freedom, sign * ratios)) for sign in (-1, 1))
    half_width = coverage_factor(freedom) * stderr * scale
    return DriftSlope(
        value * scale, stderr * scale, half_width, p_value, float(weights @ CORRELATIONS)
    )


def least_difference(y: np.ndarray) -> float:
    """Return the least difference of any two values (n,), not all equal, of a size of 1 at most."""
    apart = np.diff(np.unique(y))
    return float(apart[apart > ROUNDING].min(initial=np.ptp(y)))


def rounding_variance(model: np.ndarray, y: np.ndarray, column: int) -> float:
    """Return the variance that rounding errors of y (n,) make of a column's coefficient.

    model (n, k); of a value it is as if the errors of all were independent.
    """
    runs = 1 + int(np.count_nonzero(np.abs(np.diff(y)) > ROUNDING))
    of_value = least_difference(y) ** 2 / 12 * y.size / runs
    return of_value * float(np.linalg.inv(model.T @ model)[column, column])


def line_with_step(t: np.ndarray, step: int | None) -> np.ndarray:
    """Return the columns of a line over t (n,), and of a step at a place, if there is one."""
    return np.column_stack([np.ones_like(t), t, *([np.arange(t.size) >= step] if step else [])])


def whitened(t: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (n, k) at t (n,) whitened for each of CORRELATIONS (c, n, k), and scales (c, n).

    scales: standard deviation of each row given the one before, that of all being 1.
    """
    apart = np.diff(t)
    rho = CORRELATIONS[:, None] ** np.maximum(apart / np.median(apart), 1.0)
    rho = np.column_stack([np.zeros(CORRELATIONS.size), rho])
    scales = np.sqrt(1 - rho**2)
    before = np.concatenate([rows[:1], rows[:-1]])
    return (rows - rho[..., None] * before) / scales[..., None], scales


def _by_correlation(
    t: np.ndarray, model: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return log of the restricted likelihood, slope and its variance, for each of CORRELATIONS.

    model (n, k): the slope is that of its second column.
    """
    white, scales = whitened(t, np.column_stack([model, y]))
    model, wanted, freedom = white[..., :-1], white[..., -1:], y.size - model.shape[1]
    inverse = np.linalg.inv(model.swapaxes(1, 2) @ model)
    estimate = inverse @ (model.swapaxes(1, 2) @ wanted)
    variance = ((wanted - model @ estimate) ** 2).sum(axis=(1, 2)) / freedom
    variance = np.maximum(variance, ROUNDING**2)
    likelihood = (np.linalg.slogdet(inverse)[1] - freedom * np.log(variance)) / 2
    likelihood -= np.log(scales).sum(axis=1)
    return likelihood, estimate[:, 1, 0], variance * inverse[:, 1, 1]
