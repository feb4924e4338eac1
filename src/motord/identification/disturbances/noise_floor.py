"""Variance of white noise in a signal whose own spectrum is of lower frequencies and of lines.

    P_k = |sum_n w_n x_n exp(-2 pi j k n / N)|^2 / sum_n w_n^2,    v = median(P_k) / ln 2

over blocks of N samples with a Hann window w, and over the upper half of the frequencies: of noise
P_k is exponential with the mean v. Lines, also of a speed that changes, are in few P_k of a block.
"""

from typing import NamedTuple

import numpy as np

BLOCK = 256
"""Samples of a block: few enough for a line of a changing speed to be narrow."""

LEAST = 32
"""Samples without which nothing is known of the noise."""

RELATIVE_VARIANCE = 13.0
"""Relative variance of v, times the number of samples: by simulation 12.6 to 12.9."""


class NoiseFloor(NamedTuple):
    """Variance of the white noise, and its standard error, squares of the signal's unit."""

    variance: float
    stderr: float


def noise_floor(values: np.ndarray) -> NoiseFloor:
    """Return the white noise in evenly sampled values (n,); 0 where they are too few."""
    if values.size < LEAST:
        return NoiseFloor(0.0, 0.0)
    size = min(BLOCK, values.size)
    blocks = values[: values.size // size * size].reshape(-1, size)
    window = np.sin(np.pi * (np.arange(size) + 0.5) / size) ** 2
    about = blocks - blocks.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(window * about)) ** 2 / (window @ window)
    variance = float(np.median(power[:, size // 4 : (size + 1) // 2])) / float(np.log(2))
    return NoiseFloor(variance, variance * (RELATIVE_VARIANCE / blocks.size) ** 0.5)
