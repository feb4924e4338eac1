"""The strongest significant line of a torque less its average over the turns.

A line counts by its ratio to two floors: the median of many neighbours, and a quantile of the few
nearest ones without the line, which noise of a narrow band (a torsional resonance) raises as well.
Of n values a quantile has the relative variance c / n of a mean of n / c values, so that the ratio
is one of F, of 2 and 2 n / c degrees of freedom.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from motord.identification.operating_points import Samples

FALSE_SHARE = 1e-3
"""Probability at which white noise alone makes a line of a point, about."""

SOUGHT = 0.3
"""Distance from the nearest order, in parts of the resolution, from which on lines are sought."""

SKIRTED = 1.0
"""The same, up to which the residual of a line is wider than the resolution."""

LEAST_TURNS = 4.0
"""Order below which a line is drift."""

HIGHEST_PART = 0.8
"""Part of the highest order that turns resolve up to which lines are sought: at a speed that
ripples a time-locked line has sidebands, which the average takes out below that order alone."""

APART = 2.0
"""Distance of two lines, in parts of the resolution: nearer ones are the skirt of the first."""

PADDING = 8
"""Frequencies that are looked at within the resolution."""

NEIGHBOURS = 96
"""Resolved frequencies to either side that make the floor."""

FLOOR_STEP = 24
"""Resolved frequencies from one median of the floor to the next."""

AROUND = np.r_[-10:-1, 2:11]
"""Places, in resolved frequencies from a line, of the values that make the floor near it."""

LEFT = np.r_[-8:0, 1:9]
"""The same where the line is taken out."""

QUANTILE = 0.7
"""Of those values: up to five other lines among them do not matter."""

MEDIAN_VARIANCE = 2.08
"""Relative variance, times their number, of the median of exponential values, 1 / ln(2)^2."""

QUANTILE_VARIANCE = QUANTILE / (1 - QUANTILE) / np.log(1 - QUANTILE) ** 2
"""The same of that quantile."""

TRIALS = 2.5
"""Independent values of a periodogram on a grid so fine, in parts of the resolved ones."""


class Floor(NamedTuple):
    """Variance of white noise (Nm^2) of the density that is at a frequency.

    least_ratio: what a line's power over it is beyond in FALSE_SHARE by chance.
    """

    variance_Nm2: float
    least_ratio: float


class Periodogram:
    """Of a torque less its average over the turns, residual_Nm (n,)."""

    def __init__(self, samples: Samples, residual_Nm: np.ndarray) -> None:
        """Transform it."""
        t_s = samples.t_s[samples.whole]
        place = np.rint((t_s - t_s[0]) / samples.period_s).astype(np.int64)
        grid_Nm = np.bincount(place, residual_Nm)
        power = np.abs(np.fft.rfft(grid_Nm, PADDING * grid_Nm.size)) ** 2 / residual_Nm.size
        self._frequency_Hz = np.fft.rfftfreq(PADDING * grid_Nm.size, samples.period_s)
        self._turns, self._number = self._frequency_Hz / samples.speed_Hz, len(samples.turns)
        self._speed_Hz, self._trials = samples.speed_Hz, TRIALS * residual_Nm.size / 2
        offset = self._turns - np.rint(self._turns)
        self._from_order = np.abs(offset) * self._number
        self._shown = self._from_order > SOUGHT
        averaged = np.abs(np.sinc(self._number * offset) / np.sinc(offset)) ** 2
        self._floor_Nm2, self._values = _floor(power, self._from_order > 0.5)
        self._corrected = np.where(self._shown, power / np.maximum(1 - averaged, 1e-9), np.nan)

    def strongest_Hz(self, highest: int, tried_Hz: Sequence[float]) -> float | None:
        """Return the frequency of the strongest line apart from those tried, None by chance alone.

        First those beyond the floor near them, then those beyond the wide one alone, of which only
        the ones near an order, where the line's own skirt is in the former.
        """
        turns = self._turns
        sought = self._shown & (turns > LEAST_TURNS) & (turns < HIGHEST_PART * highest)
        for one_Hz in tried_Hz:
            sought &= np.abs(turns - one_Hz / self._speed_Hz) * self._number > APART
        ratio = np.where(sought, self._corrected, 0.0) / self._floor_Nm2
        beyond = np.flatnonzero(ratio > _limit(self._trials, self._values / MEDIAN_VARIANCE))
        beyond = beyond[np.argsort(-ratio[beyond])]
        for best in beyond:
            near = self._near(int(best), AROUND)
            if self._corrected[best] > near.least_ratio * near.variance_Nm2:
                return float(self._frequency_Hz[best])
        skirted = beyond[self._from_order[beyond] < SKIRTED]
        return float(self._frequency_Hz[skirted[0]]) if skirted.size else None

    def floor_at(self, frequency_Hz: float) -> Floor:
        """Return the larger floor at a frequency whose line is taken out."""
        best = int(np.argmin(np.abs(self._frequency_Hz - frequency_Hz)))
        wide_Nm2, near = float(self._floor_Nm2[best]), self._near(best, LEFT)
        return Floor(max(wide_Nm2, near.variance_Nm2), near.least_ratio)

    def _near(self, best: int, places: np.ndarray) -> Floor:
        """Return the floor by the nearest neighbours of a place."""
        places = best + PADDING * places
        values = self._corrected[places[(places > 0) & (places < self._corrected.size)]]
        values = values[np.isfinite(values)]
        if not values.size:
            return Floor(np.inf, 1.0)
        mean_Nm2 = float(np.quantile(values, QUANTILE)) / -np.log(1 - QUANTILE)
        return Floor(mean_Nm2, _limit(self._trials, values.size / QUANTILE_VARIANCE))


def _limit(trials: float, known: float) -> float:
    """Return what the largest of so many ratios is beyond in FALSE_SHARE by chance.

    known: values whose mean has the relative variance of the floor.
    """
    return known * float((trials / FALSE_SHARE) ** (1 / known) - 1)


def _floor(power: np.ndarray, between: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the floor of a periodogram (n,): its median over neighbours, as a mean of noise.

    And how many these are.

    between (n,): frequencies between orders, which the average over turns does not attenuate.
    """
    places = np.arange(0, power.size, PADDING)
    places = places[between[places]]
    half = min(NEIGHBOURS, (places.size - 1) // 2)
    padded = np.pad(power[places], half, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)[::FLOOR_STEP]
    median = np.median(windows, axis=1) / np.log(2)
    floor = np.interp(np.arange(power.size), places[::FLOOR_STEP], median)
    return np.asarray(np.maximum(floor, np.finfo(float).tiny)), 2 * half + 1
