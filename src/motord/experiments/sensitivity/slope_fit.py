"""Slopes of the measured ripple over one induced error: a line fitted to each of two branches.

Poels 2008, Figures 4.6 to 4.9. Near the ideal the ripple that no model explains rounds the corner
off; points of which it is a good part belong to neither line.
"""

from dataclasses import dataclass
from math import hypot, sqrt
from typing import ClassVar

import numpy as np

from motord.intervals import expanded_uncertainty

CLEAR_OF_FLOOR = 2.5
"""Theory of a point, in parts of the ripple without any error, from which on it is on a line."""


@dataclass(frozen=True)
class Branch:
    """A line through the points on one side: rms = at_ideal + slope (value - ideal), percent.

    fit_stderr: of the slope, from the residual of the line, or from the points' own errors where
    that is more (Type A); scale: relative standard uncertainty of the points' scale (Type B);
    theory_slope: of a line through the theory of the same points; used (n,): which they are.
    """

    JSON: ClassVar = (
        "points", "slope_percent=slope", "slope_stderr_percent=slope_stderr",
        "slope_half_width_percent=slope_half_width", "theory_slope_percent=theory_slope",
        "at_ideal_percent=at_ideal",
    )  # fmt: skip

    slope: float
    fit_stderr: float
    at_ideal: float
    theory_slope: float
    used: np.ndarray
    scale: float = 0.0

    @property
    def slope_stderr(self) -> float:
        """Standard error of the slope, by the line and by the scale."""
        return hypot(self.fit_stderr, self.scale * self.slope)

    @property
    def slope_half_width(self) -> float:
        """Half of the slope's 95 % interval."""
        return expanded_uncertainty(self.fit_stderr, self.points - 2, self.scale * self.slope)

    @property
    def points(self) -> int:
        """Number of points that it goes through."""
        return int(self.used.sum())


@dataclass(frozen=True)
class Series:
    """One kind of error: values (n,) rising, RMS error measured, its standard error, and theory.

    stderr_percent: of a point by itself, and of the scale that all points have in common.
    branches: below and above `ideal`; None where fewer than two values are clear of the floor.
    """

    JSON = (
        "what", "value", "measured_percent", "stderr_percent", "theory_percent", "floor_percent",
        "worst_difference_percent", "meeting", "branches",
    )  # fmt: skip

    what: str
    ideal: float
    value: np.ndarray
    measured_percent: np.ndarray
    stderr_percent: np.ndarray
    theory_percent: np.ndarray
    branches: tuple[Branch | None, Branch | None]

    @property
    def meeting(self) -> tuple[float, float] | None:
        """Return where the two lines meet: value and RMS error in percent; None without two."""
        below, above = self.branches
        if below is None or above is None or below.slope == above.slope:
            return None
        x = (above.at_ideal - below.at_ideal) / (below.slope - above.slope)
        return self.ideal + x, below.at_ideal + below.slope * x

    @property
    def floor_percent(self) -> float:
        """Return the RMS error without any induced error, see `floor_percent`."""
        off = self.value - self.ideal
        return floor_percent(off, self.measured_percent, self.theory_percent)

    @property
    def worst_difference_percent(self) -> float:
        """Return the largest difference from the theory with the floor added in quadrature."""
        expected = np.hypot(self.theory_percent, self.floor_percent)
        return float(np.abs(self.measured_percent - expected).max())


def floor_percent(off: np.ndarray, measured: np.ndarray, theory: np.ndarray) -> float:
    """Return the RMS error without any induced error, of points (n,) by how far `off` they are.

    Of the nearest to the ideal, less its theory in quadrature: it may not be at the ideal itself.
    """
    nearest = int(np.argmin(np.abs(off)))
    return sqrt(max(float(measured[nearest] ** 2 - theory[nearest] ** 2), 0.0))


def series(
    what: str,
    ideal: float,
    value: np.ndarray,
    measured_percent: np.ndarray,
    stderr_percent: np.ndarray,
    theory_percent: np.ndarray,
    *,
    scale: float = 0.0,
) -> Series:
    """Sort the points of one kind of error and fit its two branches. All arrays (n,).

    stderr_percent: of each point by itself; scale: standard uncertainty, in parts, of the measured
    values' scale, which all points have in common.
    """
    order = np.argsort(value)
    x, y, error, theory = (
        column[order] for column in (value, measured_percent, stderr_percent, theory_percent)
    )
    floor = floor_percent(x - ideal, y, theory)
    clear = theory > CLEAR_OF_FLOOR * floor
    branches = tuple(
        _line(x - ideal, y, error, theory, clear & side, scale) for side in (x < ideal, x > ideal)
    )
    stderr = np.hypot(error, scale * y)
    return Series(what, ideal, x, y, stderr, theory, (branches[0], branches[1]))


def _line(
    x: np.ndarray,
    y: np.ndarray,
    error: np.ndarray,
    theory: np.ndarray,
    used: np.ndarray,
    scale: float,
) -> Branch | None:
    if np.unique(x[used]).size < 2:  # of several recordings there may be many at one
        return None
    columns = np.column_stack([np.ones(int(used.sum())), x[used]])
    inverse = np.linalg.pinv(columns)
    at_ideal, slope = inverse @ y[used]
    left = y[used] - columns @ (at_ideal, slope)
    freedom = max(int(used.sum()) - 2, 1)
    by_rest = float(left @ left) / freedom * float(inverse[1] @ inverse[1])
    by_points = float(inverse[1] ** 2 @ error[used] ** 2)
    return Branch(
        slope=float(slope),
        fit_stderr=max(by_rest, by_points) ** 0.5,
        at_ideal=float(at_ideal),
        theory_slope=float(inverse[1] @ theory[used]),
        used=used,
        scale=scale,
    )
