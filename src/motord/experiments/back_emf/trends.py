"""What amplitudes and phases differ by from capture to capture: with the time, or the frequency.

    y_hs = c_h + b_1 z_1hs ... - d x_hs + e_hs

over the orders h and the captures s, by weighted least squares. y: amplitudes in parts, x the time
since the first capture over the whole time (magnets that warm), or half the square of the angular
frequency (a low-pass of the voltages, d the square of its time constant). Or y: angles, x velocity
times that time (clocks of inverter and encoder that run apart), with the velocity, of which the age
is fitted, as z. The mean of the amplitudes is off by d times the mean of x from what is there at
the beginning, or without filter. It is not corrected, as it may have another cause; where d is no
chance (5 %) it is variance of the amplitudes (GUM, F.2.4.5). Of clocks it is variance of phases and
age: how far off a fit with that trend has them. Where captures are too few to say what is chance,
it always is.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Literal

import numpy as np

from motord.intervals import t_quantile

FEWEST = 3
"""Captures that show a trend."""

LEAST_FREEDOM = 2
"""Degrees of freedom from which on a trend can be told from chance."""

CONFIDENCE_LEVEL = 0.975
"""One-sided, of the test from which on intervals are widened."""

RARE = 0.001
"""Probability of a finding by chance."""

Kind = Literal["time", "frequency", "clock"]


@dataclass(frozen=True)
class CaptureTrend:
    """A trend; part (m,): what the mean amplitude of each order is less by, in parts.

    ratio: of the slope to its standard error, positive where amplitudes fall; freedom: its degrees.
    slope: of clocks by how much the voltages get older in the whole time (s); moved_rad, moved_s:
    how far off the angle and the age at the beginning are without it.
    """

    kind: Kind
    slope: float
    ratio: float
    freedom: int
    part: np.ndarray
    moved_rad: float = 0.0
    moved_s: float = 0.0

    @property
    def tested(self) -> bool:
        """Whether there are captures enough to tell it from chance."""
        return self.freedom >= LEAST_FREEDOM

    @property
    def possible(self) -> bool:
        """Whether there is such a cause: no low-pass makes amplitudes larger."""
        return self.kind != "frequency" or self.ratio > 0

    @property
    def widens(self) -> bool:
        """Whether it is in the intervals."""
        return self.possible and abs(self.ratio) > t_quantile(CONFIDENCE_LEVEL, self.freedom)

    @property
    def limit(self) -> float:
        """What chance makes of the ratio."""
        return t_quantile(1 - RARE / 2, self.freedom)

    @property
    def significant(self) -> bool:
        """Whether it is a finding."""
        return self.possible and self.freedom > 0 and abs(self.ratio) > self.limit

    @property
    def beyond_chance(self) -> float:
        """Share that is more than its standard error makes of it."""
        return sqrt(max(1 - 1 / self.ratio**2, 0.0)) if self.widens else 0.0

    @property
    def part_beyond_chance(self) -> np.ndarray:
        """The part (m,) less what its standard error makes of it."""
        return self.part * self.beyond_chance

    @property
    def moved(self) -> tuple[float, float]:
        """Standard errors of angle (rad) and age (s) by clocks: all where chance is not known."""
        share = self.beyond_chance if self.tested else 1.0
        return share * abs(self.moved_rad), share * abs(self.moved_s)


@dataclass(frozen=True)
class Captures:
    """Amplitudes (n, m) in parts of their means less 1, and angles (n, m) less their means (rad).

    Of n captures and m orders, nan where an order does not stand out. variance (n, m): of the
    amplitudes, and of an angle times its order; share (n, m): of each capture in the mean; time_s,
    velocity_rad_s (n,), signed.
    """

    order: np.ndarray
    amplitude: np.ndarray
    angle_rad: np.ndarray
    variance: np.ndarray
    share: np.ndarray
    time_s: np.ndarray
    velocity_rad_s: np.ndarray

    def trends(self) -> Iterator[CaptureTrend]:
        """Yield the trends that the captures can show."""
        if len(self.amplitude) < FEWEST:
            return
        frequency_rad_s = np.outer(self.velocity_rad_s, self.order)
        yield self._trend("frequency", self.amplitude, frequency_rad_s**2 / 2)
        since_s = self.time_s - self.time_s.min()
        if since_s.max() > 0:
            part = np.outer(since_s / since_s.max(), np.ones(self.order.size))
            yield self._trend("time", self.amplitude, part)
            velocity_rad_s = np.outer(self.velocity_rad_s, np.ones(self.order.size))
            yield self._trend("clock", self.angle_rad, velocity_rad_s * part, velocity_rad_s)

    def _trend(
        self, kind: Kind, y: np.ndarray, x: np.ndarray, z: np.ndarray | None = None
    ) -> CaptureTrend:
        """Return the trend of y (n, m) with x, next to one with z."""
        part = (self.share * x).sum(axis=0) if kind != "clock" else np.zeros(self.order.size)
        known = np.isfinite(y)
        variance = self.variance / (self.order**2 if kind == "clock" else 1.0)
        root = 1 / np.sqrt(variance[known])
        means = np.eye(self.order.size)[np.nonzero(known)[1]][:, known.any(axis=0)]
        others = np.column_stack([means, *([z[known]] if z is not None else [])]) * root[:, None]
        both = np.column_stack([x[known], y[known]]) * root[:, None]
        explained = np.linalg.lstsq(others, both, rcond=None)[0]
        x_apart, y_apart = (both - others @ explained).T
        freedom = len(y) - 2 - (z is not None)
        square = float(x_apart @ x_apart)
        if not square > 1e-9 * float(both[:, 0] @ both[:, 0]):
            return CaptureTrend(kind, 0.0, 0.0, max(freedom, 1), 0 * part)
        slope = -float(x_apart @ y_apart) / square
        left = y_apart + slope * x_apart
        squares = np.bincount(np.nonzero(known)[1], left**2)
        scale = max(float(squares.max()) / max(freedom, 1), 1.0)  # orders may have it alike
        apart = explained @ [slope, 1.0]  # means and age, which the captures have as 0 without it
        moved = (float(apart[0]), float(apart[-1])) if kind == "clock" else (0.0, 0.0)
        return CaptureTrend(
            kind, slope, slope * sqrt(square / scale), freedom, slope * part, *moved
        )


def beyond_chance(found: Sequence[CaptureTrend], orders: int) -> np.ndarray:
    """Return what trends make of the amplitudes' error (m,), in parts."""
    return np.sqrt(sum((one.part_beyond_chance**2 for one in found), np.zeros(orders)))


def moved_by_clocks(found: Sequence[CaptureTrend]) -> tuple[float, float]:
    """Return the standard errors of angle (rad) and age (s) by clocks that run apart."""
    return next((one.moved for one in found if one.kind == "clock"), (0.0, 0.0))
