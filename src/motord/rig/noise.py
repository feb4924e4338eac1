"""Random numbers that are the same on every machine: the generator's state is in RIG_STATE.

MWC64X (multiply with carry, period about 2^63): the state holds x and carry c in 32 bits each,
steps to a x + c, which never overflows, and gives x xor c.
"""

import numpy as np

from motord.jit import jit

MULTIPLIER = 4294883355

_A = np.uint64(MULTIPLIER)
_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(0xFFFF)
_SHIFT = np.uint64(32)
_SHIFT_HALF = np.uint64(16)
_SCALE = 3.0**0.5 / 65536.0  # four uniforms of 16 bits have variance 4 / 12 (65536)^2
_MEAN = 2.0 * 65535.0


def random_state(seed: int) -> int:
    """Return a state of the generator for `seed`; never one of its two fixed points."""
    low, high = (int(x) for x in np.random.SeedSequence(seed).generate_state(2, np.uint32))
    return low | (high % (MULTIPLIER - 2) + 1) << 32


@jit
def gaussian(s: np.record) -> float:
    """Return a number of mean 0 and standard deviation 1, steps `s.random`.

    The sum of four uniform numbers: close to a normal distribution within +-3 and never
    beyond +-3.47.
    """
    state = s.random
    total = 0.0
    for _ in range(2):
        word = (state & _LOW) ^ (state >> _SHIFT)
        total += float(word & _HALF) + float(word >> _SHIFT_HALF)
        state = _A * (state & _LOW) + (state >> _SHIFT)
    s.random = state
    return (total - _MEAN) * _SCALE


@jit
def uniform(s: np.record) -> float:
    """Return a number of [0, 1) in steps of 2^-32, steps `s.random`."""
    state = s.random
    word = (state & _LOW) ^ (state >> _SHIFT)
    s.random = _A * (state & _LOW) + (state >> _SHIFT)
    return float(word) / 4294967296.0
