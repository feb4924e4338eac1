"""Harmonics over a turn: least-squares analysis of samples at encoder points, and synthesis.

y(theta) = Re sum_h line_h exp(j h theta) = sum_h |line_h| sin(h theta + arg(j line_h))
"""

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
    return np.asarray(np.fft.irfft(spectrum, points))


def synthesis(order: np.ndarray, lines: np.ndarray, counts: int) -> np.ndarray:
    """Return Re sum of lines (n,) or (n, m), complex, of orders (n,) at 2 pi n / counts."""
    angle_rad = 2 * np.pi * np.arange(counts) / counts
    table = np.zeros((counts, *lines.shape[1:]))
    for h, line in zip(order, lines, strict=True):
        wave = np.exp(1j * h * angle_rad)
        table += (line * wave.reshape(-1, *[1] * (lines.ndim - 1))).real
    return table


def harmonics_table(
    orders: np.ndarray, amplitude: np.ndarray, phase_rad: np.ndarray, counts: int
) -> np.ndarray:
    """Return sum of amplitude sin(order theta + phase) at theta = 2 pi n / counts (counts,)."""
    angle_rad = 2 * np.pi * np.arange(counts) / counts
    table = np.zeros(counts)
    for order, a, phase in zip(orders, amplitude, phase_rad, strict=True):
        table += a * np.sin(order * angle_rad + phase)
    return table
