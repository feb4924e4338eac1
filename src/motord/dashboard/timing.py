"""Histograms of the loop's wake-up lateness and work over the last minute."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

SECONDS = 60
EDGES_us = np.geomspace(0.1, 1e5, 6 * 8 + 1)
"""Eight bins a decade; what is outside counts in the first or the last."""
FIELDS = ("wake_late_ns", "work_ns")

_BINS = len(EDGES_us) - 1
_NS_PER_US = 1e3


class TimingHistograms:
    """Counts by second, so that what is older than a minute can be left out."""

    def __init__(self) -> None:
        self._counts = np.zeros((SECONDS, len(FIELDS), _BINS), np.int64)
        self._second = 0

    def add(self, block: NDArray[Any], now_s: float) -> None:
        """Take in ticks (n,) of one block that came at `now_s` (monotonic).

        Their own time stands still without samples of the bridge.
        """
        second = int(now_s)
        for passed in range(max(self._second + 1, second - SECONDS + 1), second + 1):
            self._counts[passed % SECONDS] = 0
        self._second = second
        for counts, name in zip(self._counts[second % SECONDS], FIELDS, strict=True):
            place = np.searchsorted(EDGES_us, block[name] / _NS_PER_US, side="right") - 1
            counts += np.bincount(np.clip(place, 0, _BINS - 1), minlength=_BINS)

    def counts(self) -> NDArray[np.float32]:
        """Return ticks in each bin of EDGES_us over the last minute, (wake-up and work, bins)."""
        total: NDArray[np.int64] = self._counts.sum(axis=0)
        return total.astype(np.float32)
