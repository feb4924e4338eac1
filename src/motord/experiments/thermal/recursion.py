"""Recursive filters, sample by sample: of `scipy.signal` a call costs more than the samples do."""

import numpy as np

from motord.jit import jit


@jit
def recur(values: np.ndarray, coefficients: np.ndarray) -> None:
    """Make y_n = x_n + sum_j a_j y_(n-j), in place, of values x (n,) and coefficients a (p,)."""
    for n in range(values.size):
        for j in range(min(n, coefficients.size)):
            values[n] += coefficients[j] * values[n - 1 - j]
