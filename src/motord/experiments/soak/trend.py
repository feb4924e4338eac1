"""The slope of a series over time with an interval that holds for autocorrelated residuals.

    y = a + b t + e,   e[i] = rho e[i - 1] + w[i],   w white

For each rho of a grid a and b by generalised least squares (Prais and Winsten 1954); the slopes are
averaged by the restricted likelihood of rho (Harville 1974), so that rho's own uncertainty is in
the variance: that within, and that of the slopes between. Degrees of freedom: n - 2.
"""

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from scipy.special import stdtr

from motord.intervals import coverage_factor

LEAST = 6
"""Values that a slope's interval needs."""

CORRELATIONS = np.linspace(0.0, 0.98, 50)
"""Of one residual with the next; drift and slower wandering cannot be told apart beyond them."""


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
    """Return the slope of y (n,) over t (n,), n >= 2, t rising."""
    t, y = t - t.mean(), y - y.mean()
    plain = float(t @ y / (t @ t))
    n = y.size
    if n < LEAST:
        return DriftSlope(plain)
    if np.abs(y - plain * t).max() <= 1e-12 * max(np.abs(y).max(), 1e-300):
        return DriftSlope(plain, 0.0, 0.0, 1.0 if plain == 0 else 0.0, 0.0)
    found = np.array([_given(rho, t, y) for rho in CORRELATIONS])
    weights = np.exp(found[:, 0] - found[:, 0].max())
    weights /= weights.sum()
    value = float(weights @ found[:, 1])
    stderr = sqrt(weights @ (found[:, 2] + (found[:, 1] - value) ** 2))
    p_value = 2 * float(stdtr(n - 2, -abs(value) / stderr if stderr else -inf))
    half_width = coverage_factor(n - 2) * stderr
    return DriftSlope(value, stderr, half_width, p_value, float(weights @ CORRELATIONS))


def _given(rho: float, t: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Return log of the restricted likelihood, slope and its variance with this correlation."""
    rows = np.column_stack([np.ones_like(t), t, y])
    first, others = rows[:1] * sqrt(1 - rho**2), rows[1:] - rho * rows[:-1]
    white = np.concatenate([first, others])
    model, wanted, freedom = white[:, :2], white[:, 2], y.size - 2
    inverse = np.linalg.inv(model.T @ model)
    estimate = inverse @ (model.T @ wanted)
    residual = wanted - model @ estimate
    variance = float(residual @ residual) / freedom
    likelihood = (
        -freedom * np.log(variance) + np.log(1 - rho**2) + np.linalg.slogdet(inverse)[1]
    ) / 2
    return float(likelihood), float(estimate[1]), variance * float(inverse[1, 1])


def drifting(p_values: "list[float | None]", false_alarms: float) -> list[bool]:
    """Return which of the slopes are no chance, all judged together (Holm 1979)."""
    known = sorted((p, place) for place, p in enumerate(p_values) if p is not None)
    sure = [False] * len(p_values)
    for rank, (p, place) in enumerate(known):
        if p > false_alarms / (len(known) - rank):
            break
        sure[place] = True
    return sure
