"""Values known at some times, or angles, wanted at others."""

import numpy as np

from motord.jit import jit

GAP = 5.5
"""Spacing of samples, in usual spacings, beyond which nobody knows what was between them."""

CROWD = 0.3
"""Spacing of samples, in usual spacings, below which one of them is left out: jitter of the clock
would make a slope of their noise."""


def fill_gaps(table: np.ndarray) -> np.ndarray:
    """Return values over one turn (counts,) with nan replaced, straight between neighbours."""
    known = np.flatnonzero(np.isfinite(table))
    if known.size == table.size:
        return table
    return np.asarray(np.interp(np.arange(table.size), known, table[known], period=table.size))


def rising(t: np.ndarray) -> np.ndarray:
    """Return which samples are newer than all before them; the others repeat one (n,)."""
    newer = np.ones(t.size, bool)
    newer[1:] = t[1:] > np.maximum.accumulate(t)[:-1]
    return newer


def uncrowded(source_s: np.ndarray) -> np.ndarray:
    """Return which of the rising times `source_s` (n,) to use, (n,): not those in a crowd."""
    keep = np.ones(source_s.size, bool)
    if source_s.size < 2:
        return keep
    least_s = CROWD * float(np.median(np.diff(source_s)))
    last_s = source_s[0]
    for n in range(1, source_s.size):
        if source_s[n] - last_s < least_s:
            keep[n] = False
        else:
            last_s = source_s[n]
    return keep


def interpolate(
    source_s: np.ndarray, values: np.ndarray, target_s: np.ndarray, result: np.ndarray
) -> None:
    """Fill `result` (m, k) with `values` (n, k), known at `source_s` (n), at times `target_s` (m).

    Cubic through the two neighbours on either side (Lagrange); straight between two samples that
    have a gap next to them. Both times rise strictly. Inside a gap, and where there are no two
    neighbours, the result is nan.
    """
    longest_s = GAP * float(np.median(np.diff(source_s))) if source_s.size > 1 else 0.0
    _interpolate(source_s, values, target_s, result, longest_s)


@jit
def _interpolate(
    source_s: np.ndarray,
    values: np.ndarray,
    target_s: np.ndarray,
    result: np.ndarray,
    longest_s: float,
) -> None:
    n = source_s.size
    j = 1
    for row in range(target_s.size):
        t = target_s[row]
        while j < n - 3 and source_s[j + 1] <= t:
            j += 1
        if n < 4 or t < source_s[1] or t > source_s[n - 2]:
            result[row] = np.nan
            continue
        t0, t1, t2, t3 = source_s[j - 1], source_s[j], source_s[j + 1], source_s[j + 2]
        if t2 - t1 > longest_s:
            result[row] = np.nan
            continue
        if t1 - t0 > longest_s or t3 - t2 > longest_s:
            share = (t - t1) / (t2 - t1)
            result[row] = (1.0 - share) * values[j] + share * values[j + 1]
            continue
        w0 = (t - t1) * (t - t2) * (t - t3) / ((t0 - t1) * (t0 - t2) * (t0 - t3))
        w1 = (t - t0) * (t - t2) * (t - t3) / ((t1 - t0) * (t1 - t2) * (t1 - t3))
        w2 = (t - t0) * (t - t1) * (t - t3) / ((t2 - t0) * (t2 - t1) * (t2 - t3))
        w3 = (t - t0) * (t - t1) * (t - t2) / ((t3 - t0) * (t3 - t1) * (t3 - t2))
        for k in range(values.shape[1]):
            result[row, k] = (
                w0 * values[j - 1, k]
                + w1 * values[j, k]
                + w2 * values[j + 1, k]
                + w3 * values[j + 2, k]
            )
