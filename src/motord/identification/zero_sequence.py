"""Zero sequence of the currents of a star connection, where it was not recorded.

A drive that reports its currents along d and q, or takes the third for minus the sum of two, leaves
nothing of what the sensed currents have in common. The loops force the others, x_p = i*_p - c; what
flows, alpha_p (x_p + c) + beta_p, adds up to nothing in a star, and that gives c once the gains are
known. An offset that all phases have in proportion to their gains is c's as well as beta's; beta is
taken to add up to nothing, so c = -sum_p alpha_p x_p / sum_p alpha_p.
"""

from dataclasses import replace

import numpy as np

from motord.identification.operating_points import Samples

SHARE = 1e-5
"""Part of the currents below which their sum is rounding: sensors have more noise than that."""


def is_missing(samples: Samples) -> bool:
    """Return whether the recorded currents have no zero sequence, not even of noise."""
    sum_A = np.abs(samples.i_A.sum(axis=1)).max()
    return bool(sum_A <= SHARE * np.abs(samples.i_A).max())


def restored(samples: Samples, alpha: np.ndarray) -> Samples:
    """Return the samples with the zero sequence of the currents that follows from gains (3,)."""
    common_A = -(samples.i_A @ alpha) / alpha.sum()
    return replace(samples, i_A=samples.i_A + common_A[:, None])
