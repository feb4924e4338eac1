"""95 % intervals by Student's t, and figures with the digits that these allow."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import floor, hypot, inf, isfinite, log10
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike

LEVEL = 0.95
"""Share of intervals that hold the truth."""

NOT_KNOWN = "interval not known"
"""After a figure without one."""

SERIOUS_BIAS = 0.3
"""Share of half of an interval above which an error of one sign leaves a verdict in doubt: an
interval that is widened by it holds the truth, but does not keep a risk above that of its end."""


@dataclass(frozen=True)
class IntervalEstimate:
    """A value with its combined standard uncertainty and 95 % interval; None: not known.

    A result that has one as `x_Nm` has x_Nm, x_stderr_Nm, x_low_Nm and x_high_Nm in its JSON.
    """

    value: float | None = None
    stderr: float | None = None
    low: float | None = None
    high: float | None = None

    def text(self, unit: str = "") -> str:
        """Return value and half of the interval, or that this is not known."""
        if self.value is None:
            return ""
        if self.high is None:
            return f"{self.value:.4g}{unit} ({NOT_KNOWN})"
        return f"{plus_minus(self.value, self.high - self.value)}{unit}"


def coverage_factor(freedom: float | None = None, figures: int = 1) -> float:
    """Return half of a 95 % interval in standard errors; freedom: degrees of, None for many.

    figures: so many intervals hold all together in 95 % of cases (Bonferroni).
    """
    outside = (1 - LEVEL) / figures
    return t_quantile(1 - outside / 2, inf if freedom is None else freedom)


def half_width_of_largest(
    values: Sequence[float], half_widths: Sequence[float | None]
) -> float | None:
    """Return half of the 95 % interval of the largest true value; None if one is not known.

    Of values that are alike the largest is too large by chance, and the largest true one may be
    another's: all intervals hold together (`coverage_factor`), up to the highest end.
    """
    known = [half for half in half_widths if half is not None]
    if len(known) < len(values):
        return None
    wider = coverage_factor(figures=len(values)) / coverage_factor()
    ends = (value + wider * half for value, half in zip(values, known, strict=True))
    return max(ends) - max(values)


def expanded_uncertainty(type_a: float, freedom: float | None, type_b: float) -> float:
    """Return the expanded uncertainty, half of the 95 % interval.

    type_a, type_b: standard uncertainties from data with `freedom` degrees of freedom, by Student's
    t, and from other knowledge, by the normal distribution. That of a calibration is of both at
    once: `uncertainty_budget`.
    """
    return hypot(coverage_factor(freedom) * type_a, coverage_factor() * type_b)


def t_quantile(probability: float, freedom: float) -> float:
    """Return the quantile of Student's t, of one degree of freedom at least."""
    return _t_quantile(probability, max(float(freedom), 1.0))  # arrays have no hash


@lru_cache(maxsize=64)
def _t_quantile(probability: float, freedom: float) -> float:
    from scipy.special import stdtrit  # 0.2 s, of each start of a client, too

    return float(stdtrit(freedom, probability))


def freedom_of(half_width: float, stderr: float) -> float | None:
    """Return the degrees of freedom by which half of a 95 % interval is so many standard errors.

    None for many: also of an interval that is narrower than that of a normal distribution. One
    where an interval is around no error at all.
    """
    if not half_width > coverage_factor() * stderr * (1 + 1e-9):
        return None
    if half_width >= coverage_factor(1.0) * stderr:
        return 1.0
    from scipy.special import stdtridf

    return float(stdtridf((1 + LEVEL) / 2, half_width / stderr))


class StandardUncertainty(NamedTuple):
    """A standard uncertainty and its degrees of freedom, None for many.

    known: False where an interval alone is stated, or one that its standard error does not explain:
    its degrees of freedom may be few.
    """

    value: float
    freedom: float | None
    known: bool = True


def standard_uncertainty(
    value: float, stderr: float | None, low: float | None, high: float | None
) -> StandardUncertainty | None:
    """Return what a figure states by its standard error, or 95 % interval, or both; None: nothing.

    Of both, degrees of freedom are those by which the longer side of the interval is t times the
    standard error. Of an interval that is longer than one degree of freedom makes it, the standard
    error counts as not stated.
    """
    if low is None or high is None:
        return None if stderr is None else StandardUncertainty(stderr, None)
    half = max(high - value, value - low)
    if stderr is None or half > coverage_factor(1.0) * stderr * (1 + 1e-9):
        return StandardUncertainty(half / coverage_factor(), None, known=False)
    return StandardUncertainty(stderr, freedom_of(half, stderr))


def f_quantile(probability: float, numerator: float, denominator: float) -> float:
    """Return the quantile of the F distribution with these degrees of freedom."""
    from scipy.special import fdtri

    return float(fdtri(numerator, denominator, probability))


def f_tail(ratio: "ArrayLike", numerator: "ArrayLike", denominator: "ArrayLike") -> "np.ndarray":
    """Return the probability that F of these degrees of freedom is above `ratio`.

    `scipy.stats` has it, too, but takes half a second to load, and many times as long for a call.
    """
    import numpy as np
    from scipy.special import fdtrc

    return np.asarray(fdtrc(numerator, denominator, np.maximum(ratio, 0.0)))


def beyond_chance(p_values: Sequence[float | None], false_alarms: float) -> list[bool]:
    """Return which of the p-values are no chance, all judged together (Holm 1979).

    One that is not finite, or None, is none, and does not count among the others.
    """
    known = sorted((p, place) for place, p in enumerate(p_values) if p is not None and isfinite(p))
    significant = [False] * len(p_values)
    for rank, (p, place) in enumerate(known):
        if p > false_alarms / (len(known) - rank):
            break
        significant[place] = True
    return significant


def two_digits(value: float) -> str:
    """Return a value with two digits: "0.034", "2.0", "160" rather than "1.6e+02"."""
    return significant(value, 2)


def significant(value: float, digits: int) -> str:
    """Return a value with so many digits, of any size: with three "0.00123", "2.00", "5120"."""
    rounded = float(f"{value:.{digits}g}")
    if not 1e-4 <= abs(rounded) < 1e6:
        return f"{rounded:.{digits - 1}e}" if rounded else "0"
    return f"{rounded:.{max(decimals_of(abs(rounded)) + digits - 2, 0)}f}"


def file_decimals(largest: float) -> int:
    """Return the decimals of a table in a file: nine, and nine digits of values below 0.1."""
    return max(9, 8 - floor(log10(largest))) if largest > 0 else 9


def decimals_of(half_width: float) -> int:
    """Return how many decimals show half of an interval with two digits; < 0 from 100 on."""
    return 1 - floor(log10(half_width) + 1e-9)


def plus_minus(value: float, half_width: float, sign: str = "+-") -> str:
    """Return value and half of its interval with two digits of the latter: "0.8012 +- 0.0034"."""
    if not (isfinite(half_width) and half_width > 0):
        return f"{value:.4g} {sign} {half_width:.2g}"
    decimals = max(decimals_of(half_width), 0)
    rounded = round(value, decimals) + 0.0  # -0.0 + 0.0 is 0.0
    return f"{rounded:.{decimals}f} {sign} {half_width:.{decimals}f}"
