"""Harmonics over a turn: least-squares analysis of samples at encoder points, and synthesis.

y(theta) = Re sum_h line_h exp(j h theta) = sum_h |line_h| sin(h theta + arg(j line_h))
"""

from collections.abc import Callable

import numpy as np

from motord.identification.orders import SAMPLES_PER_ORDER

DAMPING = 0.1
"""Damping of the highest order that the samples resolve, in parts of them, falling with the square
of the order: what a gap in the turn leaves open, where a busy computer took no samples, stays
smooth and small."""

DAMPED_ROUNDS = 5
"""Rounds of iterated Tikhonov regularisation: of what is sampled well DAMPING^5 is lost at most."""

SOLVED = 1e-5
"""Residual of a round's equations, in parts of their right side; the next round takes it up.

What a gap leaves open is solved to this part of all there is: a mean hundreds of times what is to
be found there has to be taken out before."""

NEGLIGIBLE = 1e-10
"""Residual, in parts of the sums, that no round takes up: a recording's floats have 6e-8."""


def lines_at(count: np.ndarray, values: np.ndarray, counts: int, highest: int) -> np.ndarray:
    """Return complex amplitudes of orders 0 to `highest` of values (n,) or (m, n) at counts (n,).

    values are Re(sum of line_h exp(j h theta)); line 0 is the mean. See `lines_of_sums`.
    """
    return lines_of_sums(*transforms(count, values, counts, highest))


def transforms(
    count: np.ndarray, values: np.ndarray, counts: int, highest: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return visits and sums, as `lines_of_sums` wants them, of values (n,) or (m, n) at counts."""
    visits = np.fft.fft(np.bincount(count, minlength=counts))
    columns = values.reshape(-1, count.size)
    sums = np.fft.rfft([np.bincount(count, one, minlength=counts) for one in columns])
    sums = sums.reshape(*values.shape[:-1], -1)
    return visits[np.arange(2 * highest + 1) % counts], sums[..., : highest + 1]


def lines_of_sums(visits: np.ndarray, sums: np.ndarray) -> np.ndarray:
    """Return lines (..., h + 1) of orders 0 to h by damped least squares over all samples.

    visits (..., 2 h + 1): transform of the samples at each angle; sums (..., h + 1): that of the
    sums of their values. With unevenly visited angles the normal matrix is Toeplitz, the spectrum
    of the visits: multiplied by transforms, solved by conjugate gradients (Hansen 1998, chapters 5
    and 6).
    """
    from scipy.fft import next_fast_len  # 0.2 s, of whoever asks for less

    highest, samples = sums.shape[-1] - 1, visits[..., :1].real
    damping = DAMPING * (np.arange(highest + 1) * SAMPLES_PER_ORDER / samples) ** 2
    damping = np.repeat(damping, 2, axis=-1)  # of real and imaginary parts
    grid = next_fast_len(4 * highest + 2, real=True)
    weight = np.fft.irfft(visits, grid) * (grid / samples)

    def damped(parts: np.ndarray) -> np.ndarray:
        values = np.fft.irfft(parts.view(complex), grid)
        values *= weight
        moved = np.ascontiguousarray(np.fft.rfft(values)[..., : highest + 1]).view(float)
        return np.asarray(moved + damping * parts)

    residual = np.ascontiguousarray(sums / samples).view(float)
    lines, negligible = np.zeros_like(residual), NEGLIGIBLE**2 * _inner(residual, residual)
    for _ in range(DAMPED_ROUNDS):
        found, left = _solved(damped, residual, negligible)
        lines, residual = lines + found, left + damping * found  # what the lines alone leave
    lines[..., 2:] *= 2
    return lines.view(complex)


def _solved(
    product: Callable[[np.ndarray], np.ndarray], right: np.ndarray, negligible: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solve product(x) = right (..., 2 n), each by itself, by conjugate gradients; with residual.

    negligible (..., 1): its square at which any is solved. Real and imaginary parts are side by
    side: numpy makes factors complex else.
    """
    residual = along = right
    x, square = np.zeros_like(residual), _inner(residual, residual)
    solved = np.maximum(SOLVED**2 * square, negligible)
    for _ in range(right.shape[-1]):
        unsolved = square > solved
        if not unsolved.any():
            break
        moved = product(along)
        step = _ratio(square, _inner(along, moved), unsolved)
        x, residual = x + step * along, residual - step * moved
        before, square = square, _inner(residual, residual)
        along = residual + _ratio(square, before, unsolved) * along
    return x, residual


def _ratio(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Return one over the other, 0 but `where`."""
    if where.all():  # the usual case, in a third of the time
        return np.asarray(one / other)
    return np.asarray(np.divide(one, other, out=np.zeros_like(one), where=where))


def _inner(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the inner product (..., 1) of lines as parts (..., 2 n); orders but 0 count twice."""
    products = one * other
    products = products[..., ::2] + products[..., 1::2]
    return np.asarray(2 * products.sum(axis=-1, keepdims=True) - products[..., :1])


def over_one_turn(lines: np.ndarray, points: int) -> np.ndarray:
    """Return values at `points` even angles over a turn, of lines of orders 0 to n < points / 2."""
    spectrum = np.zeros((*lines.shape[:-1], points // 2 + 1), complex)
    spectrum[..., : lines.shape[-1]] = lines * points / 2
    spectrum[..., 0] *= 2
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
