"""A field over time: a control chart for each motor or bench."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motord.results.comparison import unwrapped
from motord.results.control_chart import ControlChart, control_chart
from motord.results.stored_result import ResultRow


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
