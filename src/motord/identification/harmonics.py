"""Least-squares harmonics of values that were sampled at encoder points, however often each."""

import numpy as np
from scipy.linalg import solve_toeplitz


def lines_at(count: np.ndarray, values: np.ndarray, counts: int, highest: int) -> np.ndarray:
    """Return complex amplitudes of orders 0 to `highest` of values (n,) at counts (n,).

    values are Re(sum of line_h exp(j h theta)); line 0 is the mean. Least squares over all samples:
    with unevenly visited points the normal matrix is Toeplitz, the spectrum of the visits.
    """
    visits = np.fft.fft(np.bincount(count, minlength=counts))
    right = np.fft.fft(np.bincount(count, values, minlength=counts))
    column = visits[np.arange(2 * highest + 1) % counts]
    solution = solve_toeplitz(column, right[np.arange(-highest, highest + 1)])
    lines: np.ndarray = 2 * solution[highest:]
    lines[0] /= 2
    return lines


def over_one_turn(lines: np.ndarray, points: int) -> np.ndarray:
    """Return values at `points` even angles over a turn, of lines of orders 0 to n < points / 2."""
    spectrum = np.zeros(points // 2 + 1, complex)
    spectrum[: lines.size] = lines * points / 2
    spectrum[0] *= 2
    values: np.ndarray = np.fft.irfft(spectrum, points)
    return values
