"""Readings of a power that come slowly, and mean powers over windows of time from them.

Between two readings the power is the later one, where each is the mean since the one before; where
they are instants, it goes straight from one to the next. Its integral gives means over any window.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from motord.identification import IdentifyError

GAP_PERIODS = 2.5
"""Time without a reading, in periods, from which on readings are missing."""

SPREAD_STEPS = 0.6
"""Standard deviation of readings, in steps of their resolution, from which on their rounding errors
average out; readings of but two neighbouring values have at most half a step."""

SAME = 1e-9
"""Difference of two readings, in parts of the largest, that is of the arithmetic."""


@dataclass(frozen=True)
class PowerSeries:
    """Times t_s (n,), rising, and powers (n,) W; means: each is the mean since the one before.

    resolution_W: step in which they come, 0 if it is not known. ripple_W: limit of what the mean
    power lacks where readings are products of means, whose ripples may go together.
    """

    t_s: np.ndarray
    power_W: np.ndarray
    means: bool
    resolution_W: float = 0.0
    ripple_W: float = 0.0

    def __post_init__(self) -> None:
        if self.t_s.size < 2:
            raise IdentifyError(f"{self.t_s.size} readings of the power; at least 2 are needed")
        if (np.diff(self.t_s) <= 0).any():
            raise IdentifyError("readings of the power whose times do not rise")

    @cached_property
    def period_s(self) -> float:
        """Time between readings, the median (s)."""
        return float(np.median(np.diff(self.t_s)))

    @cached_property
    def longest_s(self) -> float:
        """Longest time without a reading (s)."""
        return float(np.diff(self.t_s).max())

    @property
    def missing(self) -> bool:
        """Whether readings are missing."""
        return self.longest_s > GAP_PERIODS * self.period_s

    @property
    def rounding_W(self) -> float:
        """Limit of the mean's rounding error: half a step, 0 where readings are spread (W)."""
        spread = float(self.power_W.std()) > SPREAD_STEPS * self.resolution_W
        return 0.0 if spread else 0.5 * self.resolution_W

    @cached_property
    def _energy_J(self) -> np.ndarray:
        """Energy since the first reading (n,)."""
        later = self.power_W[1:]
        mean_W = later if self.means else 0.5 * (later + self.power_W[:-1])
        return np.concatenate([[0.0], np.cumsum(mean_W * np.diff(self.t_s))])

    def energy_J(self, at_s: np.ndarray) -> np.ndarray:
        """Return the energy (m,) since the first reading, at times (m,) between first and last."""
        if self.means:
            return np.asarray(np.interp(at_s, self.t_s, self._energy_J))
        place = np.clip(np.searchsorted(self.t_s, at_s, side="right") - 1, 0, self.t_s.size - 2)
        since_s = at_s - self.t_s[place]
        power_W = 0.5 * (self.power_W[place] + np.interp(at_s, self.t_s, self.power_W))
        return np.asarray(self._energy_J[place] + power_W * since_s)

    def means_W(self, edges_s: np.ndarray) -> np.ndarray:
        """Return the mean power (m,) between successive edges (m + 1,)."""
        return np.asarray(np.diff(self.energy_J(edges_s)) / np.diff(edges_s))

    def within(self, begin_s: float, end_s: float) -> "PowerSeries":
        """Return the readings that are of nothing else than a time. Raises IdentifyError if few.

        A reading may be half a period away from its time.
        """
        margin_s = 0.5 * self.period_s
        inside = (self.t_s >= begin_s + margin_s) & (self.t_s <= end_s - margin_s)
        return replace(self, t_s=self.t_s[inside], power_W=self.power_W[inside])


def resolution_of(values: np.ndarray) -> float:
    """Return the smallest step between readings (n,) that differ, 0 if none do."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > SAME * np.abs(values).max(initial=0.0)]
    return float(steps.min()) if steps.size else 0.0
