"""A field over time: individuals control charts with Shewhart's limits and Western Electric rules.

    centre = mean(x),   sigma = mean(|x[i] - x[i - 1]|) / 1.128

Western Electric Company: Statistical Quality Control Handbook, 1956; ISO 7870-2. Limits are of
independent values: whether they are is tested by their first autocorrelation,

    r = sum((x[i] - mean) (x[i + 1] - mean)) / sum((x - mean)^2),

which of independent ones is normal, of a standard deviation of 1 / sqrt(n) (Bartlett 1946).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motord.intervals import coverage_factor
from motord.results.comparison import unwrapped
from motord.results.stored_result import ResultRow

D2 = 1.128
"""Mean range of two normal values, in standard deviations."""

PRELIMINARY = 20
"""Points below which limits are known badly."""

LIMIT_SIGMAS = 3
"""Distance of the control limits from the centre line."""


@dataclass(frozen=True)
class RunRule:
    """`count` of `window` successive points on one side beyond `sigmas` standard deviations."""

    number: int
    count: int
    window: int
    sigmas: float
    words: str


RULES = (
    RunRule(1, 1, 1, 3.0, "a point beyond 3 sigma"),
    RunRule(2, 2, 3, 2.0, "2 of 3 successive points beyond 2 sigma on one side"),
    RunRule(3, 4, 5, 1.0, "4 of 5 successive points beyond 1 sigma on one side"),
    RunRule(4, 8, 8, 0.0, "8 successive points on one side of the centre line"),
)
"""The Western Electric rules."""


@dataclass(frozen=True)
class ControlChart:
    """Values (n,) in order of time, with centre line and standard deviation.

    violated: rules, by number, that each point completes, n of them.
    """

    values: np.ndarray
    centre: float
    sigma: float
    violated: tuple[tuple[int, ...], ...]

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper control limit."""
        half = LIMIT_SIGMAS * self.sigma
        return self.centre - half, self.centre + half

    @property
    def preliminary(self) -> bool:
        """Whether there are too few points for limits that one can rely on."""
        return self.values.size < PRELIMINARY

    @property
    def correlation(self) -> float:
        """First autocorrelation of the values; 0 if all are the same."""
        apart = self.values - self.centre
        square = float(apart @ apart)
        return float(apart[1:] @ apart[:-1]) / square if square > 0 else 0.0

    @property
    def correlation_limit(self) -> float:
        """Correlation that about one of 40 charts of independent values exceeds."""
        return coverage_factor() / float(np.sqrt(self.values.size))

    @property
    def correlated(self) -> bool:
        """Whether values resemble those before, so that limits are too narrow for them."""
        return self.correlation > self.correlation_limit


def control_chart(values: np.ndarray) -> ControlChart:
    """Return the chart of values (n,), n >= 2; all of them count for the limits.

    Raises ValueError for fewer.
    """
    if values.size < 2:
        raise ValueError("a control chart needs two points")
    centre = float(values.mean())
    sigma = float(np.abs(np.diff(values)).mean()) / D2
    return ControlChart(values, centre, sigma, violations(values, centre, sigma))


def violations(values: np.ndarray, centre: float, sigma: float) -> tuple[tuple[int, ...], ...]:
    """Return which rules each value (n,) completes; it is itself one of the points that count."""
    rounding = 4 * np.spacing(abs(centre))
    found: list[list[int]] = [[] for _ in values]
    for rule in RULES:
        for side in (1, -1):
            beyond = side * (values - centre) > rule.sigmas * sigma + rounding
            before = np.concatenate([[0], np.cumsum(beyond)])
            first = np.maximum(np.arange(values.size) + 1 - rule.window, 0)
            enough = before[1:] - before[first] >= rule.count
            for place in np.flatnonzero(beyond & enough):
                found[place].append(rule.number)
    return tuple(map(tuple, found))


@dataclass(frozen=True)
class Trend:
    """Results of one field, n of one serial number, motor or bench, in order of time."""

    name: str
    rows: Sequence[ResultRow]

    @cached_property
    def values(self) -> np.ndarray:
        """The values (n,)."""
        return unwrapped([row.figure for row in self.rows])

    @cached_property
    def chart(self) -> ControlChart | None:
        """The control chart; None of a single result."""
        return control_chart(self.values) if len(self.rows) > 1 else None

    @property
    def violated(self) -> list[tuple[int, ...]]:
        """Rules that each point completes, n of them."""
        return list(self.chart.violated) if self.chart else [()] * len(self.rows)

    @property
    def errors(self) -> np.ndarray:
        """Distances of the values from the ends of their 95 % intervals (2, n); nan: not stated."""
        ends = [(row.value, row.low, row.high) for row in self.rows]
        distances = [
            (np.nan, np.nan) if low is None or high is None else (value - low, high - value)
            for value, low, high in ends
        ]
        return np.array(distances).T

    @property
    def stderr(self) -> float | None:
        """RMS of the standard errors that are stated; None if none is."""
        known = [row.stderr for row in self.rows if row.stderr is not None]
        return float(np.sqrt(np.mean(np.square(known)))) if known else None


def trends(rows: Sequence[ResultRow], by: str) -> list[Trend]:
    """Return the trend of each group, in order of their names; by: the column that names them."""
    groups: dict[str, list[ResultRow]] = {}
    for row in rows:
        groups.setdefault(getattr(row, by), []).append(row)
    return [Trend(name, groups[name]) for name in sorted(groups)]
