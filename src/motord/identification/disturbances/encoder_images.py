"""Images of the encoder's counts: lines that are locked to the rotor and do not look it.

Currents that are commanded by the count make a torque at the rate of the counts and its multiples,
m counts speed, which is beyond half the sampling rate f_s. Samples show it at |m counts speed -
k f_s|: at no order, and yet its phase is that of the shaft.
"""

import numpy as np

from motord.identification.disturbances.periodogram import APART
from motord.identification.operating_points import Samples

MULTIPLES = 4
"""Multiples m that count: the steps of a staircase have 1/m of the first, less what lags take."""


def image_frequencies_Hz(samples: Samples, counts: int) -> np.ndarray:
    """Return where the samples of whole turns show multiples of the rate of the counts (m,).

    By straight lines through time and counts: of the ends alone the rate is known to some counts
    over the whole time, which is more than the turns resolve. Times that jitter have whole periods
    between them.
    """
    t_s, count = samples.t_s[samples.whole], samples.count[samples.whole]
    ticks = np.cumsum(np.rint(np.diff(t_s, prepend=t_s[0]) / samples.period_s))
    period_s = float(np.polyfit(ticks, t_s, 1)[0])
    rate_Hz = abs(float(np.polyfit(t_s, np.unwrap(count.astype(float), period=counts), 1)[0]))
    multiples_Hz = rate_Hz * np.arange(1, MULTIPLES + 1)
    return np.asarray(np.abs(multiples_Hz - np.rint(multiples_Hz * period_s) / period_s))


def is_image(samples: Samples, frequency_Hz: float, images_Hz: np.ndarray) -> bool:
    """Return whether a line is nearer to an image than lines are that differ."""
    apart_Hz = float(np.abs(images_Hz - frequency_Hz).min())
    return apart_Hz * len(samples.turns) <= APART * samples.speed_Hz
