"""Values sampled at one set of times, wanted at another."""

import numpy as np

from motord.jit import jit


@jit
def interpolate(
    source_s: np.ndarray, values: np.ndarray, target_s: np.ndarray, result: np.ndarray
) -> None:
    """Fill `result` (m, k) with `values` (n, k), known at `source_s` (n), at times `target_s` (m).

    Cubic through the two neighbours on either side (Lagrange). Both times rise strictly. Where
    there are no such neighbours, the result is nan.
    """
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
