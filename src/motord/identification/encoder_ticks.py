"""Ticks of a capture whose turns its encoder counts, without those that it disturbed."""

import numpy as np

from motord.identification import CaptureError
from motord.identification.resample import rising
from motord.identification.signal_condition import SignalFault
from motord.identification.turning import countable
from motord.schema import rows_of


def countable_ticks(
    ticks: np.ndarray, counts: int, label: str
) -> tuple[np.ndarray, np.ndarray, tuple[SignalFault, ...]]:
    """Return the ticks (m,) of a capture (n,) whose counts can be, these unwrapped, and faults.

    Raises CaptureError if its turns cannot be counted.
    """
    ticks = sampled_ticks(ticks, label)
    t_s = (ticks["t_ns"].astype(np.int64) - ticks["t_ns"][:1].astype(np.int64)) * 1e-9
    good, position, faults = countable(t_s, ticks["encoder_count"].astype(np.int64), counts, label)
    return rows_of(ticks, good), position, faults


def sampled_ticks(ticks: np.ndarray, label: str) -> np.ndarray:
    """Return the ticks (m,) of a capture (n,) with a sample of their own.

    A tick that no new sample reached repeats the one before: with clocks of loop and board that
    differ by 35 ppm, every 28 s at 1 kHz. Raises CaptureError if times go back.
    """
    t_ns = ticks["t_ns"].astype(np.int64)
    if (np.diff(t_ns) < 0).any():
        raise CaptureError(f"{label}: times go back")
    return rows_of(ticks, rising(t_ns))
