"""Ticks of a capture whose turns its encoder counts, without those that it disturbed."""

import numpy as np

from motord.identification import CaptureError
from motord.identification.signal_condition import (
    SignalFault,
    misread,
    misread_counts,
    out_of_range,
)
from motord.identification.turning import countable
from motord.schema import rows_of


def countable_ticks(
    ticks: np.ndarray, counts: int, label: str
) -> tuple[np.ndarray, tuple[SignalFault, ...]]:
    """Return the ticks (m,) of a capture (n,) with counts that can be, and what is wrong with it.

    Raises CaptureError if its turns cannot be counted.
    """
    t_s = (ticks["t_ns"].astype(np.int64) - ticks["t_ns"][:1].astype(np.int64)) * 1e-9
    if (np.diff(t_s) <= 0).any():
        raise CaptureError(f"{label}: times do not rise")
    good = countable(t_s, ticks["encoder_count"].astype(np.int64), counts, label)
    faults, count = out_of_range(good), ticks["encoder_count"][good].astype(np.int64)
    good[good] = ~misread(count, counts)
    return rows_of(ticks, good), (*faults, *misread_counts(count, counts))
