"""Averages over encoder angle: gaps between encoder points, drift over the turns.

METHODS: averages are always over encoder angle, never over time.
"""

import numpy as np

from motord.identification.operating_points import Samples


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
