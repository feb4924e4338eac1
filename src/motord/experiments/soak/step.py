"""A step of a series over time: when it was, its size, and whether chance explains it.

    y = a + b t + c H(i - k) + e,   e as in `soak.trend`

c and its t-ratio by generalised least squares for every place k and each rho (intervention
analysis, Box and Tiao 1975), its p-value that of the mixture of t distributions over rho, as for a
slope, with n - 3 degrees of freedom. The place is that of the least p-value, times the number of
places (Bonferroni), which holds whatever their correlation is. The least difference of two values,
which may be their resolution, counts as no step: the p-value is of what |c| is beyond it.

A bench that warms up has no step: c exp(-t/tau), with any of TIME_CONSTANTS, in place of
c H(i - k) has as many parameters, so that information criteria differ by twice the difference of
the log likelihoods; that must be PREFERRED or more.
"""

from dataclasses import dataclass
from math import sqrt
from typing import ClassVar

import numpy as np
from scipy.special import stdtr

from motord.experiments.soak.trend import (
    PRIOR,
    ROUNDING,
    least_difference,
    line_with_step,
    rounding_variance,
    whitened,
)
from motord.intervals import coverage_factor

LEAST_SIDE = 3
"""Values before and after a step: one or two that are off are no step."""

LEAST = 10
"""Values that a step needs."""

FALSE_ALARMS = 0.01
"""Part of the soaks without a step in which one may be claimed, all figures together."""

TIME_CONSTANTS = np.geomspace(0.01, 0.5, 24)
"""Of a relaxation, in parts of the time from the first value to the last."""

PREFERRED = 10.0
"""Difference of the Bayesian information criteria from which on evidence is very strong (Kass and
Raftery 1995)."""


@dataclass(frozen=True)
class Step:
    """A step with half of its 95 % interval, and p-value of none at all, 1 where a relaxation
    explains it as well.

    place: the first value after it; hours: the middle between that and the one before; unit: that
    of the values.
    """

    JSON: ClassVar = ("hours", "value", "unit", "half_width", "p_value")

    place: int
    hours: float
    value: float
    half_width: float
    p_value: float
    unit: str = ""


def most_likely_step(t: np.ndarray, y: np.ndarray) -> Step | None:
    """Return the step of y (n,) over t (n,), hours, rising; None of few values, or equal ones."""
    n, scale = y.size, float(np.abs(y).max()) or 1.0
    y = (y - y.mean()) / scale
    if n < LEAST or np.abs(y).max() <= ROUNDING:
        return None
    places = np.arange(LEAST_SIDE, n - LEAST_SIDE + 1)
    likelihoods, values, variances = _by_correlation(t - t.mean(), y, places)
    weights = PRIOR[:, None] * np.exp(likelihoods - likelihoods.max(axis=0))
    weights /= weights.sum(axis=0)
    beyond = np.maximum(np.abs(values) - least_difference(y), 0.0)
    tails = stdtr(n - 3, -beyond / np.sqrt(variances))
    p_values = 2 * (weights * tails).sum(axis=0)
    best = int(np.argmin(p_values))
    weight, value = weights[:, best], float(weights[:, best] @ values[:, best])
    place = int(places[best])
    rounding = rounding_variance(line_with_step(t - t.mean(), place), y, 2)
    stderr = sqrt(weight @ (variances[:, best] + (values[:, best] - value) ** 2) + rounding)
    p_value = min(float(p_values[best]) * places.size, 1.0)
    half_width = coverage_factor(n - 3) * stderr * scale
    if p_value < FALSE_ALARMS and _relaxes_instead(t, y, place):
        p_value = 1.0
    return Step(place, float(t[place - 1] + t[place]) / 2, value * scale, half_width, p_value)


def _relaxes_instead(t: np.ndarray, y: np.ndarray, place: int) -> bool:
    """Return whether a step at a place of y (n,) over t (n,) is not preferred to a relaxation."""
    part = (t - t[0]) / (t[-1] - t[0])
    relaxing = [np.exp(-part / one) for one in TIME_CONSTANTS]
    step = (np.arange(t.size) >= place).astype(float)
    line = line_with_step(t - t.mean(), None)
    white, scales = whitened(t, np.column_stack([line, *relaxing, step, y]))

    def likelihood(column: int) -> float:
        """Return the log likelihood with a column next to the line, the largest over rho."""
        triangular = np.asarray(np.linalg.qr(white[..., [0, 1, column, -1]], mode="r"))
        size = np.abs(triangular[:, -1, -1])  # of the residual
        logarithms = -t.size * np.log(np.maximum(size, ROUNDING)) - np.log(scales).sum(axis=1)
        return float(logarithms.max())

    first, last = line.shape[1], line.shape[1] + len(relaxing)
    most = max(likelihood(column) for column in range(first, last))
    return 2 * (likelihood(last) - most) < PREFERRED


def _by_correlation(
    t: np.ndarray, y: np.ndarray, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return log of the restricted likelihood, step and its variance (c, k), of rho and place.

    The step is orthogonal to the line by Frisch, Waugh and Lovell; sums from its place on make all
    places as cheap as one.
    """
    white, scales = whitened(t, np.column_stack([np.ones_like(t), t, y]))
    line, size = np.linalg.qr(white[..., :2])
    wanted = white[..., 2:]
    residual = wanted - line @ (line.swapaxes(1, 2) @ wanted)
    after = white[..., :1]  # of a step, whitened: this after its place, 1 / scale there

    def of_step(columns: np.ndarray) -> np.ndarray:
        later = np.cumsum((after * columns)[:, ::-1], axis=1)[:, ::-1] - after * columns
        return np.asarray((later + columns / scales[..., None])[:, places])

    square = np.cumsum((after**2)[:, ::-1], axis=1)[:, ::-1] - after**2 + scales[..., None] ** -2.0
    square = square[:, places, 0] - (of_step(line) ** 2).sum(axis=2)
    value = of_step(residual)[..., 0] / square
    freedom = t.size - 3
    left = (residual**2).sum(axis=(1, 2))[:, None] - value**2 * square
    variance = np.maximum(left / freedom, ROUNDING**2)
    determinant = np.log(np.abs(np.diagonal(size, axis1=1, axis2=2))).sum(axis=1)
    likelihood = -freedom / 2 * np.log(variance) - np.log(square) / 2
    likelihood -= (np.log(scales).sum(axis=1) + determinant)[:, None]
    return likelihood, value, variance / square
