"""Counting a time into a histogram, in compiled code."""

import numpy as np

from motord.jit import jit
from motord.shm.histogram import BINS, bin_of

_bin_of = jit(bin_of)


@jit
def count_time(cells: np.ndarray, time_ns: int) -> None:
    """Count a time in `cells`, shape (CELLS,)."""
    cells[_bin_of(time_ns)] += 1
    cells[BINS] = max(cells[BINS], time_ns)
