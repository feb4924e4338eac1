"""Times counted in logarithmic bins: 32 to the octave, exact below 64 ns, up to 2.1 s.

`add` works on integers and a fixed array, so the loop can call it in every tick.
"""

import numpy as np
from pydantic import BaseModel, ConfigDict

_BITS = 5
BINS = (32 - _BITS) << _BITS
"""Number of bins for values below 2**31 ns."""


def _lower_edges_ns() -> np.ndarray:
    index = np.arange(BINS + 1, dtype=np.int64)
    octave = np.maximum((index >> _BITS) - 1, 0)
    edges_ns: np.ndarray = (index - (octave << _BITS)) << octave
    return edges_ns


EDGES_ns = _lower_edges_ns()
"""Lower edge of each bin and the upper edge of the last, shape (BINS + 1,), ns."""


class TimeSummary(BaseModel):
    """A histogram for people and files. `bins` holds [lower edge ns, count] of those not empty."""

    model_config = ConfigDict(frozen=True)

    samples: int = 0
    p50_us: float = 0.0
    p99_us: float = 0.0
    p999_us: float = 0.0
    max_us: float = 0.0
    bins: list[tuple[int, int]] = []


class TimeHistogram:
    """Counts of times in ns; negative times count as 0, those from 2**31 ns on in the last bin."""

    def __init__(self) -> None:
        self.counts = np.zeros(BINS, dtype=np.int64)
        self._cells = self.counts.data
        self.max_ns = 0

    def add(self, time_ns: int) -> None:
        """Count one time."""
        if time_ns > self.max_ns:
            self.max_ns = time_ns
        octave = time_ns.bit_length() - 6
        if octave > 0:
            index = (octave << 5) + (time_ns >> octave)
            self._cells[index if index < BINS else BINS - 1] += 1
        else:
            self._cells[time_ns if time_ns > 0 else 0] += 1

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
