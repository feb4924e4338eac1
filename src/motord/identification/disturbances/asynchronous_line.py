"""Narrow lines of a torque that are not locked to the rotor, such as mains hum.

The average over N turns keeps of a line of d turns' frequencies beyond an order D = sin(pi N d) /
(N sin(pi d)) of its amplitude, in even as in odd turns, so that their difference does not show it.
The line is sought in the torque less that average: periodogram over its floor, over 1 - D^2, the
part of the line's power that is in there; its largest value against chance by Fisher's test (Fisher
1929; of a coloured floor Percival and Walden 1993, 10.9). Nearer to an order than NEAREST of the
resolution it is not distinguished from a ripple that changes from turn to turn, and nearer than
AMPLITUDE_KNOWN_FROM its residual may be fitted with a fraction of its amplitude. Images of the
encoder's counts are fitted, but are none of these lines: they are locked to the rotor.

Currents that are commanded by the count make a torque at the rate of the counts and its multiples,
m counts speed, which is beyond half the sampling rate f_s. Samples show it at |m counts speed -
k f_s|: at no order, and yet its phase is that of the shaft.
"""

from typing import NamedTuple

import numpy as np

from motord.identification.disturbances.periodogram import APART, Periodogram
from motord.identification.harmonics import over_one_turn
from motord.identification.operating_points import Samples
from motord.identification.orders import resolved_order
from motord.identification.point_ripple import AsynchronousLine, even_and_odd, without_drift
from motord.identification.signal_condition import is_stuck

NEAREST = 0.1
"""Distance from the nearest order, in parts of the resolution, beyond which a line is fitted."""

AMPLITUDE_KNOWN_FROM = 0.45
"""The same, beyond which its amplitude is known by the fit: residuals of lines within 0.1 were
fitted at up to 0.4."""

STANDS_OUT = 4.0
"""Standard errors that the amplitude of a line has at least, by itself and by its frequency."""

SECTORS = 64
"""Parts of a turn each of which has samples, or there is no average over turns that could leave a
line: a track of the encoder is stuck."""

MOST_LINES = 4
MOST_TRIED = 6
ROUNDS = 4
"""Steps of Gauss and Newton, from a frequency within an eighth of the resolution."""

MULTIPLES = 4
"""Multiples m that count: the steps of a staircase have 1/m of the first, less what lags take."""


def asynchronous_lines(samples: Samples, counts: int) -> tuple[AsynchronousLine, ...]:
    """Return the lines beyond chance, strongest first.

    One turn alone shows none, nor does an encoder with a line that never changes: what its angles
    leave of the ripple would be lines.
    """
    if len(samples.turns) < 2 or is_stuck(samples.faults):
        return ()
    sectors = np.bincount(samples.count[samples.whole] * SECTORS // counts, minlength=SECTORS)
    if not sectors.all():
        return ()
    fewest = min(end - first for first, end in samples.turns)
    highest = max(resolved_order(fewest, counts, fewest), 1)
    residual_Nm = _asynchronous(samples, without_drift(samples, samples.torque_Nm), highest, counts)
    found: list[AsynchronousLine] = []
    tried_Hz: list[float] = []
    images_Hz = image_frequencies_Hz(samples, counts)
    periodogram = Periodogram(samples, residual_Nm)
    while len(tried_Hz) < MOST_TRIED and len(found) < MOST_LINES:
        frequency_Hz = periodogram.strongest_Hz(highest, tried_Hz)
        if frequency_Hz is None:
            break
        tried_Hz.append(frequency_Hz)
        fit = _fitted(samples, residual_Nm, frequency_Hz, (highest, counts))
        residual = Periodogram(samples, fit.residual_Nm)
        floor = residual.floor_at(fit.frequency_Hz)
        line = fit.line(samples, floor.variance_Nm2)
        apart = from_order(samples, line.frequency_Hz) > 1.001 * NEAREST
        removed_Nm2 = float(residual_Nm @ residual_Nm - fit.residual_Nm @ fit.residual_Nm)
        gain = removed_Nm2 / (2 * floor.variance_Nm2)
        if apart and line.amplitude_Nm > STANDS_OUT * line.stderr_Nm and gain > floor.least_ratio:
            residual_Nm, periodogram = fit.residual_Nm, residual
            if not is_image(samples, line.frequency_Hz, images_Hz):
                found.append(line)
    return tuple(sorted(found, key=lambda line: -line.amplitude_Nm))


def from_order(samples: Samples, frequency_Hz: float) -> float:
    """Return how far a frequency is from the nearest order, in parts of the resolution."""
    turns = frequency_Hz / samples.speed_Hz
    return abs(turns - round(turns)) * len(samples.turns)


def waves(samples: Samples, frequency_Hz: float) -> np.ndarray:
    """Return cosine and sine of a frequency at the samples of whole turns (2, n)."""
    phase_rad = 2 * np.pi * frequency_Hz * samples.t_s[samples.whole]
    return np.array([np.cos(phase_rad), np.sin(phase_rad)])


class _Fit(NamedTuple):
    """A line: frequency, amplitude with its variance for noise of 1, residual (n,)."""

    frequency_Hz: float
    amplitude_Nm: float
    variance: float
    residual_Nm: np.ndarray

    def line(self, samples: Samples, noise_Nm2: float) -> AsynchronousLine:
        """Return it with its standard error by the variance of white noise."""
        amplitude_known = from_order(samples, self.frequency_Hz) > AMPLITUDE_KNOWN_FROM
        stderr_Nm = float(np.sqrt(noise_Nm2 * self.variance))
        return AsynchronousLine(self.frequency_Hz, self.amplitude_Nm, stderr_Nm, amplitude_known)


def _fitted(
    samples: Samples, residual_Nm: np.ndarray, frequency_Hz: float, orders: tuple[int, int]
) -> _Fit:
    """Return a line of the residual (n,) near a frequency by Gauss and Newton.

    orders: highest order and encoder counts. The frequency keeps its side of the nearest order; its
    error is in that of the amplitude.
    """
    t_s, speed_Hz = samples.t_s[samples.whole], samples.speed_Hz
    middle_s, resolution_Hz = float(t_s.mean()), speed_Hz / len(samples.turns)
    order = round(frequency_Hz / speed_Hz)
    side = 1.0 if frequency_Hz > order * speed_Hz else -1.0
    for _ in range(ROUNDS):
        pair = waves(samples, frequency_Hz)
        columns = np.column_stack([*_asynchronous(samples, pair, *orders)])
        parts_Nm = np.linalg.lstsq(columns, residual_Nm, rcond=None)[0]
        slope = 2 * np.pi * (t_s - middle_s) * (parts_Nm[1] * pair[0] - parts_Nm[0] * pair[1])
        every = np.column_stack([columns, _asynchronous(samples, slope, *orders)])
        inverse = np.linalg.pinv(every.T @ every)
        step_Hz, before_Hz = float((inverse @ (every.T @ residual_Nm))[2]), frequency_Hz
        frequency_Hz += float(np.clip(step_Hz, -resolution_Hz / 4, resolution_Hz / 4))
        apart_Hz = max(side * (frequency_Hz - order * speed_Hz), NEAREST * resolution_Hz)
        frequency_Hz = order * speed_Hz + side * apart_Hz
        if frequency_Hz == before_Hz:  # at its side's end, where all further rounds are the same
            break
    amplitude_Nm = float(np.hypot(*parts_Nm))
    along = np.array([*(parts_Nm / amplitude_Nm), 0.0])
    return _Fit(
        frequency_Hz, amplitude_Nm, along @ inverse @ along, residual_Nm - columns @ parts_Nm
    )


def _asynchronous(samples: Samples, values: np.ndarray, highest: int, counts: int) -> np.ndarray:
    """Return values (..., n) of whole turns less their mean and their average over the turns."""
    values = values - values.mean(axis=-1, keepdims=True)
    lines = even_and_odd(samples, values, counts, highest).mean(axis=0)
    table = over_one_turn(np.insert(lines, 0, 0.0, axis=-1), counts)
    return np.asarray(values - table[..., samples.count[samples.whole]])


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
