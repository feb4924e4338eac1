"""Standard errors from successive blocks of turns, 95 % intervals of sums of errors, and sampling.

Errors of successive blocks are correlated in either sense: noise goes on from block to block, a
ripple that instants are read from beats from block to block and averages out. The mean has what is
slow of them (equally weighted cosine estimator; Mueller 2004, Lazarus, Lewis, Stock and Watson
2018):

    se^2 = 1/G 1/B sum_j (q_j' y)^2,    freedom = B = 0.4 G^(2/3), 3 or more

of the G blocks y, with cos(pi j (n - 1/2) / G) at j = 2 ... B + 1, orthonormal to each other, to a
constant and to a straight line, as q_j: a drift belongs to what is measured.
"""

from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from motord.cached_arrays import cached_arrays
from motord.experiments.torque_speed.power_series import PowerSeries
from motord.experiments.torque_speed.turns import CapturedTurns
from motord.intervals import LEVEL, IntervalEstimate

LEAST_BLOCKS = 4
"""Blocks of turns from which on their scatter is a standard error."""

LEAST_FREEDOM = 3
"""Degrees of freedom that a standard error has, where there are so many blocks."""

DRAWS = 20_000
"""Draws of a sum of errors (JCGM 101)."""

FREEDOM_MAX = 100
"""Degrees of freedom from which on Student's t counts as normal."""

SHIFTS = 24
"""Positions of the readings relative to the rotor that are tried."""


@dataclass(frozen=True)
class Scatter:
    """Standard error of a mean and its degrees of freedom; drift: from beginning to end."""

    stderr: float
    freedom: int
    drift: float
    drift_stderr: float


def scatter_of(values: np.ndarray) -> Scatter:
    """Return the standard error of the mean of successive blocks (g,), LEAST_BLOCKS or more."""
    courses = _slow_courses(values.size)
    line, *slow = courses @ values
    rise = float(courses[0, -1] - courses[0, 0])
    deviation = sqrt(float(np.mean(np.square(slow))))
    return Scatter(
        stderr=deviation / sqrt(values.size),
        freedom=len(slow),
        drift=float(line) * rise,
        drift_stderr=deviation * abs(rise),
    )


def freedom_of_blocks(blocks: int) -> int:
    """Return the degrees of freedom of the scatter of so many blocks, LEAST_BLOCKS or more."""
    return min(max(LEAST_FREEDOM, int(0.4 * blocks ** (2 / 3))), blocks - 2)


@cached_arrays()
def _slow_courses(number: int) -> np.ndarray:
    """Return a straight line and slow cosines (1 + b, number), orthonormal, of no mean."""
    place = (np.arange(number) + 0.5) / number
    cosines = np.cos(np.pi * np.outer(place, np.arange(2, freedom_of_blocks(number) + 2)))
    courses = np.column_stack([np.ones(number), place, cosines])
    return np.asarray(np.linalg.qr(courses)[0].T[1:])


@dataclass(frozen=True)
class ErrorSum:
    """Errors of a quantity that add: half-widths of rectangular ones, standard uncertainties of
    normal ones, and the scatter."""

    rectangular: tuple[float, ...]
    normal: tuple[float, ...]
    scatter: Scatter

    @property
    def stderr(self) -> float:
        """Combined standard uncertainty (JCGM 100)."""
        return hypot(*self.normal, self.scatter.stderr, *(a / sqrt(3) for a in self.rectangular))

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval, from draws of the sum (JCGM 101)."""
        uniform, normal = _draws(len(self.rectangular))
        total = np.asarray(self.rectangular) @ uniform + hypot(*self.normal) * normal
        total += self.scatter.stderr * _student(min(self.scatter.freedom, FREEDOM_MAX))
        return float(np.quantile(np.abs(total), LEVEL))

    def around(self, value: float, factor: float = 1) -> IntervalEstimate:
        """Return a value with what these errors make of it, all times a factor."""
        half = self.half_width
        parts = (value, self.stderr, value - half, value + half)
        return IntervalEstimate(*(factor * part for part in parts))


@cached_arrays()
def _draws(sources: int) -> tuple[np.ndarray, np.ndarray]:
    """Return uniform draws (sources, d) of -1 to 1, and normal ones (d,)."""
    rng = np.random.default_rng(1)
    return rng.uniform(-1.0, 1.0, (sources, DRAWS)), rng.standard_normal(DRAWS)


@cached_arrays()
def _student(freedom: int) -> np.ndarray:
    """Return draws (d,) of Student's t."""
    return np.random.default_rng(2).standard_t(freedom, DRAWS)


def sampling_error_W(turns: CapturedTurns, series: PowerSeries, edges_s: np.ndarray) -> float:
    """Return the standard error of the mean power that slow readings cause and no scatter shows.

    The course of the mechanical power over a turn stands for that of the electrical one. It is read
    as the series is, each reading up to half a period away from its time, and blocks between the
    edges (g + 1,) are made of it: the mean square of what that changes, less that of the standard
    error by the scatter of these blocks. With that, readings in step with the rotor show, and a
    time that a reading may be late.
    """
    course = _continued(turns, series)
    ends_s = edges_s[[0, -1]]
    true_W = course.means_W(ends_s)[0]
    squares_W2 = []
    for part in (np.arange(SHIFTS) + 0.5) / SHIFTS - 0.5:
        at_s = series.t_s + part * series.period_s
        if series.means:
            read_W = np.concatenate([[0.0], course.means_W(at_s)])
        else:
            read_W = np.interp(at_s, course.t_s, course.power_W)
        read = PowerSeries(series.t_s, read_W, series.means)
        error_W = float(read.means_W(ends_s)[0] - true_W)
        squares_W2.append(error_W**2 - scatter_of(read.means_W(edges_s)).stderr ** 2)
    return sqrt(max(float(np.mean(squares_W2)), 0.0))


def _continued(turns: CapturedTurns, series: PowerSeries) -> PowerSeries:
    """Return the power's course by tick, a period longer than the readings at either end.

    Beyond the capture the rotor is taken to go on as it did.
    """
    step_s = turns.tick_s
    begin_s, end_s = turns.t_s[turns.edges[[0, -1]]]
    turn_s = (end_s - begin_s) / (turns.edges.size - 1)
    first_s = min(series.t_s[0] - series.period_s, begin_s)
    t_s = np.arange(first_s, max(series.t_s[-1] + series.period_s, end_s) + step_s, step_s)
    inside_s = t_s + turn_s * np.ceil(np.maximum(turns.t_s[0] - t_s, 0) / turn_s)
    inside_s -= turn_s * np.ceil(np.maximum(t_s - turns.t_s[-1], 0) / turn_s)
    return PowerSeries(t_s, np.interp(inside_s, turns.t_s, turns.course_W), means=False)
