"""Whether temperatures are steady: the slope of each over a window, with its own uncertainty.

A straight line is fitted to the readings of the last window. Its residuals may be correlated
(first-order autoregression rho, also by a line that is bent), so the slope's variance is that of
white noise times (1 + rho) / (1 - rho). The resolution q of the readings adds q^2 / 12 of variance
for each run of the very same number, which has one rounding error throughout.
Not that of `soak.trend`, which knows no rounding and takes 40 times as long for 500 readings.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from motord.intervals import coverage_factor
from motord.sequencing.observation import ChannelValue

CORRELATION_MAX = 0.95
"""Largest correlation of successive readings that is allowed for."""

LEAST_READINGS = 8
"""Readings in a window below which no slope is stated."""

LOOKS = 50
"""How often in a window the slope is taken anew."""

READINGS_KEPT = 500
"""Readings of a window that its slope is of, however fast a channel is: they take a millisecond."""

NOT_ALL = 0.95
"""Part of the window that readings must span."""

LEAST_RUNS = 6
"""Rounding errors that a slope has at least: with 6 the variance is that of one at either end."""

LAST_PART = 0.25
"""Part of a window before a channel stood still, in which it must have moved to be suspected."""

STEPS_MOVED = 3.0
"""Steps of its resolution that it must have moved by: what settles with a seventh of the window or
more as time constant moves by less before its last step."""


@dataclass(frozen=True)
class TemperatureSlope:
    """A slope, K/min, with half of its 95 % interval."""

    K_per_min: float
    half_width_K_per_min: float

    def within(self, limit_K_per_min: float) -> bool:
        """Return whether it is below a limit with its interval."""
        return abs(self.K_per_min) + self.half_width_K_per_min <= limit_K_per_min


def slope_of(t_s: np.ndarray, value_C: np.ndarray, resolution_K: float = 0.0) -> TemperatureSlope:
    """Return the slope of readings (n,), LEAST_READINGS or more."""
    number, centred_s = t_s.size, t_s - t_s.mean()
    spread_s2 = float(centred_s @ centred_s)
    rate = float(centred_s @ value_C) / spread_s2
    residual = value_C - value_C.mean() - rate * centred_s
    square = float(residual @ residual)
    rho = float(residual[1:] @ residual[:-1]) / square if square > 0 else 0.0
    rho = min(max(rho + (1 + 3 * max(rho, 0.0)) / number, 0.0), CORRELATION_MAX)
    runs = max(1 + int(np.count_nonzero(np.diff(value_C))), LEAST_RUNS)
    variance = square / (number - 2) / spread_s2 * (1 + rho) / (1 - rho)
    variance += resolution_K**2 / 12 * number / runs / spread_s2
    freedom = max(number * (1 - rho) / (1 + rho) - 2, 1.0)
    return TemperatureSlope(60 * rate, 60 * coverage_factor(freedom) * float(np.sqrt(variance)))


@dataclass
class ChannelWindow:
    """The readings of a channel over the last `window_s`, and over the one before.

    slope: None until they span it. changed: they were not all the same number. changed_s: when the
    newest number was first read. moved_K: by how much it moved in the last part of a window before
    it stood still for a window, 0 if it does not.
    """

    window_s: float
    slope: TemperatureSlope | None = None
    newest: float = float("nan")
    changed: bool = False
    changed_s: float = 0.0
    moved_K: float = 0.0
    _resolution_K: float = float("inf")
    _newest_s: float = -float("inf")
    _readings: deque[tuple[float, float]] = field(default_factory=deque)
    _due_s: float = -float("inf")

    @property
    def still_s(self) -> float:
        """Time for which the newest number is read."""
        return self._newest_s - self.changed_s if self._readings else 0.0

    def take(self, reading: ChannelValue) -> None:
        """Take the newest reading; one that was taken before changes nothing."""
        if reading.t_s <= self._newest_s:
            return
        self._newest_s = reading.t_s
        if reading.value != self.newest:
            if self._readings:
                self.changed = True
                self._resolution_K = min(self._resolution_K, abs(reading.value - self.newest))
            self.changed_s, self.moved_K = reading.t_s, 0.0
        self.newest = reading.value
        if self._readings and reading.t_s < self._readings[-1][0] + self.window_s / READINGS_KEPT:
            return
        self._readings.append((reading.t_s, reading.value))
        while reading.t_s - self._readings[0][0] > 2 * self.window_s:
            self._readings.popleft()
        if reading.t_s >= self._due_s:
            self._due_s = reading.t_s + self.window_s / LOOKS
            self.slope = self._slope()
        if self.changed and not self.moved_K and self.still_s >= NOT_ALL * self.window_s:
            since_s = self.changed_s - LAST_PART * self.window_s
            self.moved_K = self.newest - next(v for t_s, v in self._readings if t_s >= since_s)

    def may_be_frozen(self, limit_K_per_min: float) -> bool:
        """Return whether it stands still though it moved, beyond a limit, right before."""
        limit_K = limit_K_per_min / 60 * LAST_PART * self.window_s
        return abs(self.moved_K) > max(limit_K, STEPS_MOVED * self._resolution_K)

    def is_steady(self, limit_K_per_min: float) -> bool:
        """Return whether the slope is known, and below a limit with its interval."""
        steady = self.slope is not None and self.slope.within(limit_K_per_min)
        return steady and not self.may_be_frozen(limit_K_per_min)

    def _slope(self) -> TemperatureSlope | None:
        t_s, value_C = np.array(self._readings).T
        within = t_s >= t_s[-1] - self.window_s
        t_s, value_C = t_s[within], value_C[within]
        if t_s.size < LEAST_READINGS or np.ptp(t_s) < NOT_ALL * self.window_s:
            return None
        return slope_of(t_s, value_C, self._resolution_K if self.changed else 0.0)
