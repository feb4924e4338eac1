"""The slope of a series over time with an interval that holds for autocorrelated residuals.

    y = a + b t + e,   e[i] = rho e[i - 1] + w[i],   w white

For each rho of a grid a and b by generalised least squares (Prais and Winsten 1954), weighted by
the restricted likelihood of rho (Harville 1974) times a prior, so that rho's own uncertainty is in
the variance: that within, and that of the slopes between. Degrees of freedom: n - 2. The p-value is
that of the mixture of t distributions over rho, whose tails are wider than those of one t.
Not that of `thermal.steadiness`, which takes rho as known: of 8 values at 0.5 it claims 14 % wrong.
"""

from dataclasses import dataclass
from math import isfinite, sqrt

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

    None but for the slope of too few values. correlation: of one residual with the next.
    """

    value: float
    stderr: float | None = None
    half_width: float | None = None
    p_value: float | None = None
    correlation: float | None = None


def slope(t: np.ndarray, y: np.ndarray) -> DriftSlope:
    """Return the slope of y (n,) over t (n,), n >= 2, t rising, all finite."""
    scale = float(np.abs(y).max()) or 1.0
    t, y, n = t - t.mean(), y / scale, y.size
    y = y - y.mean()
    plain = float(t @ y / (t @ t))
    if np.abs(y).max() <= ROUNDING:
        plain = 0.0
    if n < LEAST:
        return DriftSlope(plain * scale)
    if np.abs(y - plain * t).max() <= ROUNDING:
        return DriftSlope(plain * scale, 0.0, 0.0, 1.0 if plain == 0 else 0.0, 0.0)
    likelihoods, slopes, variances = _by_correlation(t, y)
    weights = PRIOR * np.exp(likelihoods - likelihoods.max())
    weights /= weights.sum()
    value = float(weights @ slopes)
    stderr = sqrt(weights @ (variances + (slopes - value) ** 2))
    ratios = slopes / np.sqrt(variances)
    p_value = min(2 * float(weights @ stdtr(n - 2, sign * ratios)) for sign in (-1, 1))
    half_width = coverage_factor(n - 2) * stderr * scale
    return DriftSlope(
        value * scale, stderr * scale, half_width, p_value, float(weights @ CORRELATIONS)
    )


def _by_correlation(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return log of the restricted likelihood, slope and its variance, for each of CORRELATIONS."""
    rows, rho = np.column_stack([np.ones_like(t), t, y]), CORRELATIONS[:, None, None]
    first, others = rows[:1] * np.sqrt(1 - rho**2), rows[1:] - rho * rows[:-1]
    white = np.concatenate([first, others], axis=1)
    model, wanted, freedom = white[..., :2], white[..., 2:], y.size - 2
    inverse = np.linalg.inv(model.swapaxes(1, 2) @ model)
    estimate = inverse @ (model.swapaxes(1, 2) @ wanted)
    variance = ((wanted - model @ estimate) ** 2).sum(axis=(1, 2)) / freedom
    likelihood = (
        -freedom * np.log(variance) + np.log(1 - CORRELATIONS**2) + np.linalg.slogdet(inverse)[1]
    ) / 2
    return likelihood, estimate[:, 1, 0], variance * inverse[:, 1, 1]


def drifting(p_values: "list[float | None]", false_alarms: float) -> list[bool]:
    """Return which of the slopes are no chance, all judged together (Holm 1979).

    One without a finite p-value is none, and does not count among the others.
    """
    known = sorted((p, place) for place, p in enumerate(p_values) if p is not None and isfinite(p))
    significant = [False] * len(p_values)
    for rank, (p, place) in enumerate(known):
        if p > false_alarms / (len(known) - rank):
            break
        significant[place] = True
    return significant
