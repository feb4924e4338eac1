"""What the lines of a rotor differ by between speeds: an age, slipping angles, gains; each tested.

    line_s = mean (1 + gain_s - j order shift_s),   shift_s = velocity_s age + rest_s

What is measured later than the angle turns order h by h velocity age; an encoder that slips on its
shaft shifts all orders' angle; a gain that changes with temperature, or with frequency, scales
lines. Each is had from all orders at once, by weighted least squares, and compared by F with how
turns differ. Directions have means of their own: friction differs between them.

What shifts and gains of the s speeds of a direction differ by beyond noise is a variance between
them (DerSimonian and Laird 1986), of which their mean has a part:

    tau^2 = max(Q - nu, 0) / sum_d (sum w - sum w^2 / sum w),    Q = sum_s w_s (y_s - y_d)^2

with nu, speeds less directions, degrees of freedom.
"""

from dataclasses import dataclass, field, replace
from math import sqrt

import numpy as np

from motord.intervals import f_quantile, t_quantile

FALSE_SHARE = 0.002
"""Probability at which chance alone makes one of the three significant."""

SEPARATE = 1e-3
"""Part of the velocities' squares that must be left within directions to show an age."""

ROUNDS = 4
"""Fits of the shifts, each of lines turned back by what was found: the residual is small."""


@dataclass(frozen=True)
class SpeedDifference:
    """The largest size of a departure, and what chance reaches in FALSE_SHARE of all runs.

    stderr: of the mean of both directions, by how speeds differ beyond their noise; half_width: of
    its 95 % interval.
    """

    size: float
    limit: float
    stderr: float = 0.0
    half_width: float = 0.0

    @property
    def significant(self) -> bool:
        """Whether it is beyond what chance gives."""
        return abs(self.size) > self.limit


NOTHING = SpeedDifference(0.0, 0.0)


@dataclass(frozen=True)
class SpeedDifferences:
    """Each the largest; nothing where the speeds show none.

    age_s: positive if what was measured is older than the angle; shift_rad: of the angle besides;
    gain: in parts. shifts_rad, gains (s,): of each speed against the mean of its direction.
    """

    age_s: SpeedDifference = NOTHING
    shift_rad: SpeedDifference = NOTHING
    gain: SpeedDifference = NOTHING
    shifts_rad: np.ndarray = field(default_factory=lambda: np.zeros(0))
    gains: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def without_common(self, speed: int, line: np.ndarray, order: np.ndarray) -> np.ndarray:
        """Return lines (n,) of orders (n,) at a speed less the shift and gain that they share."""
        turned_back = np.exp(1j * order * self.shifts_rad[speed])
        return np.asarray(line * turned_back / (1 + self.gains[speed]))


def speed_differences(
    lines: np.ndarray,
    stderr: np.ndarray,
    order: np.ndarray,
    velocity_rad_s: np.ndarray,
    freedom: float,
) -> SpeedDifferences:
    """Return what lines (s, n) of orders (n,) differ by between s speeds.

    order h is Re(line exp(j h theta)); stderr (s, n): per component, of so many degrees of freedom;
    velocity_rad_s (s,): negative backwards.
    """
    turning = np.sign(velocity_rad_s)
    ways = np.column_stack([turning == way for way in np.unique(turning)]).astype(float)
    moving = np.column_stack([ways, velocity_rad_s])
    shift_rad = np.zeros(velocity_rad_s.size)
    for _ in range(ROUNDS):
        back = np.exp(1j * np.outer(shift_rad, order))
        further_rad, known, gain, scaled = _changes(lines * back, stderr, order, ways)
        shift_rad = shift_rad + further_rad
    slipped = _largest_residual(shift_rad, known, moving, freedom)
    scaling = _largest_residual(gain, scaled, ways, freedom)
    return SpeedDifferences(
        _slope(shift_rad, known, moving, freedom),
        _with_mean(slipped, shift_rad, known, ways),
        _with_mean(scaling, gain, scaled, ways),
        shift_rad,
        gain,
    )


def _changes(
    lines: np.ndarray, stderr: np.ndarray, order: np.ndarray, ways: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return each speed's shift of the angle and gain (s,) against its direction's mean.

    Each followed by its weight, 1 / variance. ways (s, directions): 1 for a speed's direction.
    """
    weight = 1 / np.maximum(stderr, 1e-300) ** 2
    mean = ways @ ((ways.T @ (weight * lines)) / (ways.T @ weight))
    apart, power = (lines - mean) * mean.conj(), weight * np.abs(mean) ** 2
    turned, scaled = (order**2 * power).sum(axis=1), power.sum(axis=1)
    shift_rad = -(weight * order * apart.imag).sum(axis=1) / turned
    return shift_rad, turned, (weight * apart.real).sum(axis=1) / scaled, scaled


def _residual(values: np.ndarray, weight: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return the residual of weighted values (s,) on weighted columns (s, m)."""
    root = np.sqrt(weight)
    x, y = columns * root[:, None], values * root
    return np.asarray(y - x @ np.linalg.lstsq(x, y, rcond=None)[0])


def _slope(
    values: np.ndarray, weight: np.ndarray, columns: np.ndarray, freedom: float
) -> SpeedDifference:
    """Return the last column's coefficient, besides the others; its limit is by residuals, too."""
    own = _residual(columns[:, -1], weight, columns[:, :-1])
    information = float(own @ own)
    if information <= SEPARATE * float(weight @ columns[:, -1] ** 2):
        return NOTHING
    size = float(own @ (values * np.sqrt(weight))) / information
    residual = _residual(values, weight, columns)
    scatter = max(float(residual @ residual) / max(values.size - columns.shape[1], 1), 1.0)
    quantile = t_quantile(1 - FALSE_SHARE / 2, freedom)
    return SpeedDifference(size, quantile * float(np.sqrt(scatter / information)))


def _largest_residual(
    values: np.ndarray, weight: np.ndarray, columns: np.ndarray, freedom: float
) -> SpeedDifference:
    """Return the largest residual of the values on the columns, if it is more than noise."""
    residual = _residual(values, weight, columns)
    terms = values.size - int(np.linalg.matrix_rank(columns))
    if terms < 1:
        return NOTHING
    ratio = float(residual @ residual) / terms / f_quantile(1 - FALSE_SHARE, terms, freedom)
    size = float(np.abs(residual / np.sqrt(weight)).max())
    return SpeedDifference(size, size / max(float(np.sqrt(ratio)), 1e-300))


def _with_mean(
    found: SpeedDifference, values: np.ndarray, weight: np.ndarray, ways: np.ndarray
) -> SpeedDifference:
    """Return it with what tau^2 of values (s,) of such weights makes of their mean's error."""
    freedom, weights = values.size - ways.shape[1], ways * weight[:, None]
    if freedom < 1:
        return found
    share, residual = weights / weights.sum(axis=0), _residual(values, weight, ways)
    information = float((weights * (1 - share)).sum())
    between = max(float(residual @ residual) - freedom, 0.0) / information
    stderr = sqrt(between * float((share**2).sum())) / ways.shape[1]
    return replace(found, stderr=stderr, half_width=t_quantile(0.975, freedom) * stderr)
