"""The speed of the rotor over the turn, by how long it is at each angle."""

import numpy as np

from motord.identification.operating_points import Samples
from motord.identification.orders import resolved_order

SPEED_ORDERS = 64
"""Orders of the turn up to which the speed varies: above, the rotor's inertia smooths it."""

SLOWEST_SHARE = 5.0
"""Share of samples at an angle, over the mean, that is believed at most; 1 / it at least."""


def velocity_over_turn(samples: Samples, counts: int) -> np.ndarray:
    """Return the mean velocity at each count (counts,), rad/s.

    A rotor spends the more time at an angle the slower it is there. Where no samples were taken it
    turns evenly.
    """
    fewest = min(end - first for first, end in samples.turns)
    lines = np.fft.rfft(np.bincount(_counts_at_even_times(samples, counts), minlength=counts))
    lines[resolved_order(fewest, counts, SPEED_ORDERS) + 1 :] = 0
    share = np.fft.irfft(lines / lines[0].real * counts, counts)
    share = np.clip(share, 1 / SLOWEST_SHARE, SLOWEST_SHARE)
    return np.asarray(2 * np.pi * samples.velocity_Hz / share)


def _counts_at_even_times(samples: Samples, counts: int) -> np.ndarray:
    """Return the counts (n,) of whole turns at even times, a sampling period apart."""
    found = []
    for first, end in samples.turns:
        t_s = samples.t_s[first:end]
        even_s = np.arange(t_s[0], t_s[-1] + samples.period_s / 2, samples.period_s)
        found.append(np.interp(even_s, t_s, np.unwrap(samples.count[first:end], period=counts)))
    return np.rint(np.concatenate(found)).astype(int) % counts
