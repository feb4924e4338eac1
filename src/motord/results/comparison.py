"""Two sets of results compared: differences, their combined uncertainty, and which are no chance.

    u(A - B)^2 = u(A)^2 + u(B)^2,   degrees of freedom by Welch and Satterthwaite (JCGM 100, G.4)
    u(A)^2 = max(mean(u_i^2), s^2 / n)   of the mean of n results with scatter s

What the results state may be an error that they have in common, such as the gain of the bench's
torque sensor: only their scatter is divided by their number. The two sides count as independent.
Of so many differences some are large by chance: p-values are judged together, by Holm (1979).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, inf, isinf, pi, remainder, sqrt

import numpy as np
from scipy.special import stdtr

from motord.intervals import LEVEL, beyond_chance, coverage_factor, standard_uncertainty
from motord.results.figures import ResultFigure

FALSE_ALARMS = 1 - LEVEL
"""Probability that chance alone makes any difference count, where nothing has changed."""

FREEDOM_UNKNOWN = 2.0
"""Degrees of freedom of an interval without a standard error: those of three repetitions.

Of two there would be one, with which hardly any change could be found.
"""


def unwrapped(figures: Sequence[ResultFigure]) -> np.ndarray:
    """Return the values (n,) of one field; phases within half a turn of the first."""
    first = figures[0]
    return np.array(
        [first.value + without_turns(first, one.value - first.value) for one in figures]
    )


def without_turns(one: ResultFigure, difference: float) -> float:
    """Return a difference from a figure, of a phase without whole turns."""
    phase = one.unit == "rad" and "phase" in one.field.rpartition(".")[2]
    return remainder(difference, 2 * pi) if phase else difference


@dataclass(frozen=True)
class MeanFigure:
    """A figure by one or more results: mean, standard uncertainty, its degrees of freedom.

    uncertainty: None where no result states any, and their scatter does not show it.
    """

    value: float
    uncertainty: float | None
    freedom: float
    results: int


Key = tuple[str, str, str]
"""Experiment, field and unit, which results have in common."""


@dataclass(frozen=True)
class Difference:
    """b less a, half of its 95 % interval and p-value, both None without any uncertainty.

    changed: it is more than the uncertainties explain.
    """

    experiment: str
    field: str
    unit: str
    a: MeanFigure
    b: MeanFigure
    difference: float
    half_width: float | None
    p_value: float | None
    changed: bool = False


def compare(
    a: Mapping[Key, Sequence[ResultFigure]], b: Mapping[Key, Sequence[ResultFigure]]
) -> list[Difference]:
    """Return the differences of what both have, in the order of a.

    Several figures of one key are results that are averaged.
    """
    found = [_difference(key, a[key], b[key]) for key in a if key in b]
    changed = beyond_chance([one.p_value for one in found], FALSE_ALARMS)
    return [
        replace(one, changed=True) if its else one for one, its in zip(found, changed, strict=True)
    ]


def mean_of(results: Sequence[ResultFigure]) -> MeanFigure:
    """Return the mean of results of one field (one at least), n of them.

    Its uncertainty is the larger one of what a result states in the (quadratic) mean (those that
    state none are taken to be like the others) and of what their scatter shows of their mean.
    """
    values = unwrapped(results)
    n = len(values)
    each = [_uncertainty(one) for one in results]
    known = [(u, freedom) for u, freedom in each if u is not None]
    stated, freedom = None, inf
    if known:
        stated = sqrt(_mean([u**2 for u, _ in known]))
        freedom = _welch(known)
    if n > 1:
        scatter = float(np.std(values, ddof=1) / np.sqrt(n))
        if stated is None or scatter > stated:
            stated, freedom = scatter, n - 1
    return MeanFigure(_mean(values), stated, freedom, n)


def _mean(values: Sequence[float] | np.ndarray) -> float:
    """Return the mean; numpy takes 20 times as long for one value."""
    return float(np.mean(values)) if len(values) > 1 else float(values[0])


def _difference(key: Key, of_a: Sequence[ResultFigure], of_b: Sequence[ResultFigure]) -> Difference:
    a, b = mean_of(of_a), mean_of(of_b)
    difference = without_turns(of_a[0], b.value - a.value)
    if a.uncertainty is None or b.uncertainty is None:
        return Difference(*key, a, b, difference, None, None)
    u = hypot(a.uncertainty, b.uncertainty)
    freedom = max(_welch([(a.uncertainty, a.freedom), (b.uncertainty, b.freedom)]), 1.0)
    t = abs(difference) / u if u > 0 else (inf if difference else 0.0)
    p_value = 2 * float(stdtr(freedom, -t))
    half = coverage_factor(None if isinf(freedom) else freedom) * u
    return Difference(*key, a, b, difference, half, p_value)


def _uncertainty(one: ResultFigure) -> tuple[float | None, float]:
    """Return standard uncertainty and degrees of freedom; FREEDOM_UNKNOWN of an interval alone."""
    stated = standard_uncertainty(one.value, one.stderr, one.low, one.high)
    if stated is None:
        return None, inf
    if not stated.known:
        return stated.value, FREEDOM_UNKNOWN
    return stated.value, inf if stated.freedom is None else stated.freedom


def _welch(parts: Sequence[tuple[float, float]]) -> float:
    """Return the effective degrees of freedom of a sum of uncertainties."""
    whole = sum(u**2 for u, _ in parts)
    doubt = sum(u**4 / freedom for u, freedom in parts)
    return whole**2 / doubt if doubt > 0 else inf
