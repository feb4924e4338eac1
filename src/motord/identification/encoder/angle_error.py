"""What an encoder that is off by e sin(m theta + phi) does to the orders of what it shows.

Order h, with x = h e, keeps J0(x) of its size; its sidebands at h + m and h - m have J1(x).
"""

import numpy as np
from scipy.special import j0

MOST_LOST = 0.9
"""Part of an order that is lost, up to which the loss is computed."""


def kept(x: np.ndarray) -> np.ndarray:
    """Return the part (n,) of their size that orders keep, by the x (n,) of an error."""
    return np.asarray(j0(np.minimum(x, 2.4)))


def lost(part: np.ndarray) -> np.ndarray:
    """Return the part (n,) by which orders are larger than they look, by what they keep (n,)."""
    return np.asarray(1 / np.maximum(part, 1 - MOST_LOST) - 1)


def from_sidebands(ratio: complex) -> complex:
    """Return x exp(j phi) of J1(x) / J0(x) exp(j phi)."""
    return 2 * ratio * (1 - min(abs(ratio), 1.0) ** 2 / 2)
