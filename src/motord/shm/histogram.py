"""Times counted in logarithmic bins: 32 to the octave, exact below 64 ns, up to 2.1 s.

A histogram is an array of CELLS integers: the count of each bin, then the largest time. The loop's
compiled tick counts into such arrays (`shm.time_count`); they may lie in shared memory
(`shm.timing`).
"""

import numpy as np
from pydantic import BaseModel

BITS = 5
"""Of a bin's number within its octave."""
BINS = (32 - BITS) << BITS
"""Number of bins for values below 2**31 ns."""
CELLS = BINS + 1


_INDEX = np.arange(BINS + 1, dtype=np.int64)
_OCTAVE = np.maximum((_INDEX >> BITS) - 1, 0)
EDGES_ns = (_INDEX - (_OCTAVE << BITS)) << _OCTAVE
"""Lower edge of each bin and the upper edge of the last, shape (BINS + 1,), ns."""


class TimeSummary(BaseModel, frozen=True):
    """A histogram for people and files. `bins` holds [lower edge ns, count] of those not empty."""

    samples: int = 0
    p50_us: float = 0.0
    p99_us: float = 0.0
    p999_us: float = 0.0
    max_us: float = 0.0
    bins: list[tuple[int, int]] = []


class TimeHistogram:
    """Counts of times in ns, kept in `cells` (int64, shape (CELLS,); by default its own)."""

    def __init__(self, cells: np.ndarray | None = None) -> None:
        self.cells = np.zeros(CELLS, np.int64) if cells is None else cells

    @classmethod
    def of(cls, summary: TimeSummary) -> "TimeHistogram":
        """Return the histogram that `summary` was made of."""
        histogram = cls()
        for edge_ns, number in summary.bins:
            histogram.counts[np.searchsorted(EDGES_ns, edge_ns)] += number
        histogram.cells[BINS] = round(summary.max_us * 1e3)
        return histogram

    @property
    def counts(self) -> np.ndarray:
        """Number of times in each bin, shape (BINS,)."""
        return self.cells[:BINS]

    @property
    def max_ns(self) -> int:
        """The largest time."""
        return int(self.cells[BINS])

    def merge(self, other: "TimeHistogram") -> None:
        """Count all times of `other` too."""
        self.counts[:] += other.counts
        self.cells[BINS] = max(self.max_ns, other.max_ns)

    def since(self, earlier: "TimeHistogram") -> "TimeHistogram":
        """Return what was counted after the copy `earlier`; its largest time is good to 3 %."""
        later = TimeHistogram(self.cells.copy())
        later.counts[:] -= earlier.counts
        used = np.flatnonzero(later.counts)
        largest_ns = int(EDGES_ns[used[-1] + 1]) - 1 if used.size else 0
        later.cells[BINS] = min(self.max_ns, largest_ns)
        return later

    def quantile_ns(self, fraction: float) -> float:
        """Return the time that `fraction` of the samples do not exceed; nan without samples.

        It is interpolated within its bin, so it is good to 3 %, and never above the largest.
        """
        total = int(self.counts.sum())
        if total == 0:
            return float("nan")
        reached = np.cumsum(self.counts)
        index = int(np.searchsorted(reached, max(fraction * total, 1e-9)))
        below = int(reached[index] - self.counts[index])
        share = (fraction * total - below) / int(self.counts[index])
        low_ns, high_ns = int(EDGES_ns[index]), int(EDGES_ns[index + 1])
        return min(low_ns + share * (high_ns - low_ns), float(self.max_ns))

    def summary(self) -> TimeSummary:
        """Return quantiles and the bins that are not empty."""
        used = np.flatnonzero(self.counts)
        if not used.size:
            return TimeSummary()
        return TimeSummary(
            samples=int(self.counts.sum()),
            p50_us=self.quantile_ns(0.5) / 1e3,
            p99_us=self.quantile_ns(0.99) / 1e3,
            p999_us=self.quantile_ns(0.999) / 1e3,
            max_us=self.max_ns / 1e3,
            bins=[(int(EDGES_ns[i]), int(self.counts[i])) for i in used],
        )
