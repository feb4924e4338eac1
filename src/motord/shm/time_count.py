"""Counting a time into a histogram, in compiled code."""

import math

import numpy as np

from motord.jit import jit
from motord.shm.histogram import BINS, BITS


@jit
def _bin_of(time_ns: int) -> int:
    """Return the bin of a time; a negative one counts as 0, a long one is in the last."""
    if time_ns <= 0:
        return 0
    octave = math.frexp(time_ns)[1] - 1 - BITS  # frexp gives the number of bits
    if octave <= 0:
        return time_ns
    return min((octave << BITS) + (time_ns >> octave), BINS - 1)


@jit
def count_time(cells: np.ndarray, time_ns: int) -> None:
    """Count a time in `cells`, shape (CELLS,)."""
    cells[_bin_of(time_ns)] += 1
    cells[BINS] = max(cells[BINS], time_ns)
