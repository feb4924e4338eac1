"""Averages over encoder angle: sums and numbers of samples at each encoder point.

METHODS: averages are always over encoder angle, never over time.
"""

from dataclasses import dataclass

import numpy as np

from motord.identification.operating_points import Samples
from motord.jit import jit


@dataclass(frozen=True)
class EncoderSums:
    """Sums (counts, m) of m values at each encoder point, and samples there, hits (counts,)."""

    sums: np.ndarray
    hits: np.ndarray

    @classmethod
    def of(cls, count: np.ndarray, values: np.ndarray, counts: int) -> "EncoderSums":
        """Sum up values (n, m) at encoder counts (n,)."""
        sums, hits = np.zeros((counts, values.shape[1])), np.zeros(counts, np.int64)
        _add_up(count, values, sums, hits)
        return cls(sums, hits)

    def means(self) -> np.ndarray:
        """Return the mean at each encoder point (counts, m); nan where there is no sample."""
        with np.errstate(invalid="ignore"):
            means: np.ndarray = self.sums / self.hits[:, None]
        return means


@jit
def _add_up(count: np.ndarray, values: np.ndarray, sums: np.ndarray, hits: np.ndarray) -> None:
    for row in range(count.size):
        n = count[row]
        hits[n] += 1
        for column in range(values.shape[1]):
            sums[n, column] += values[row, column]


def fill_gaps(table: np.ndarray) -> np.ndarray:
    """Return values over one turn (counts,) with nan replaced, straight between neighbours."""
    known = np.flatnonzero(np.isfinite(table))
    if known.size == table.size:
        return table
    filled: np.ndarray = np.interp(np.arange(table.size), known, table[known], period=table.size)
    return filled


def without_drift(samples: Samples, torque_Nm: np.ndarray) -> np.ndarray:
    """Return the torque of all whole turns less its drift, which follows the means of the turns.

    The drift goes straight from the middle of one turn to that of the next, so all orders of the
    turn stay as they are.
    """
    whole = samples.whole
    t_s = samples.t_s
    means = np.array([torque_Nm[first:end].mean() for first, end in samples.turns])
    middles_s = np.array([t_s[first:end].mean() for first, end in samples.turns])
    drift = np.interp(t_s[whole], middles_s, means)
    steady: np.ndarray = torque_Nm[whole] - drift
    return steady
