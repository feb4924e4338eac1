"""Whether temperatures are steady: the slope of each over a window, with its own uncertainty.

A straight line is fitted to the readings of the last window. Its residuals may be correlated
(first-order autoregression rho, also by a line that is bent), so the slope's variance is that of
white noise times (1 + rho) / (1 - rho).
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

NOT_ALL = 0.95
"""Part of the window that readings must span."""


@dataclass(frozen=True)
class TemperatureSlope:
    """A slope, K/min, with half of its 95 % interval."""

    K_per_min: float
    half_K_per_min: float

    def within(self, limit_K_per_min: float) -> bool:
        """Return whether it is below a limit with its interval."""
        return abs(self.K_per_min) + self.half_K_per_min <= limit_K_per_min


def slope_of(t_s: np.ndarray, value_C: np.ndarray) -> TemperatureSlope:
    """Return the slope of readings (n,), LEAST_READINGS or more."""
    number, centred_s = t_s.size, t_s - t_s.mean()
    spread_s2 = float(centred_s @ centred_s)
    rate = float(centred_s @ value_C) / spread_s2
    residual = value_C - value_C.mean() - rate * centred_s
    square = float(residual @ residual)
    rho = float(residual[1:] @ residual[:-1]) / square if square > 0 else 0.0
    rho = min(max(rho + (1 + 3 * max(rho, 0.0)) / number, 0.0), CORRELATION_MAX)
    variance = square / (number - 2) / spread_s2 * (1 + rho) / (1 - rho)
    freedom = max(number * (1 - rho) / (1 + rho) - 2, 1.0)
    return TemperatureSlope(60 * rate, 60 * coverage_factor(freedom) * float(np.sqrt(variance)))


@dataclass
class ChannelWindow:
    """The readings of a channel over the last `window_s`. slope: None until they span it."""

    window_s: float
    slope: TemperatureSlope | None = None
    newest: float = float("nan")
    changed: bool = False
    _readings: deque[tuple[float, float]] = field(default_factory=deque)
    _due_s: float = -float("inf")

    def take(self, reading: ChannelValue) -> None:
        """Take the newest reading; one that was taken before changes nothing."""
        if self._readings and reading.t_s <= self._readings[-1][0]:
            return
        self.changed |= bool(self._readings) and reading.value != self.newest
        self.newest = reading.value
        self._readings.append((reading.t_s, reading.value))
        while reading.t_s - self._readings[0][0] > self.window_s:
            self._readings.popleft()
        if reading.t_s >= self._due_s:
            self._due_s = reading.t_s + self.window_s / LOOKS
            self.slope = self._slope()

    def is_steady(self, limit_K_per_min: float) -> bool:
        """Return whether the slope is known, and below a limit with its interval."""
        return self.slope is not None and self.slope.within(limit_K_per_min)

    def _slope(self) -> TemperatureSlope | None:
        spanned_s = self._readings[-1][0] - self._readings[0][0]
        if len(self._readings) < LEAST_READINGS or spanned_s < NOT_ALL * self.window_s:
            return None
        return slope_of(*np.array(self._readings).T)
