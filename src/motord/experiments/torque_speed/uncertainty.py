"""Standard errors from successive blocks of turns, 95 % intervals of sums of errors, and sampling.

A block's error may depend on that of the block before (first-order autoregression):

    se^2 = s^2 / G (1 + rho) / (1 - rho),    freedom = (G - 2) (1 - rho^2) / (1 + rho^2)

with s the scatter about a straight line over the G blocks: a drift belongs to what is measured.
"""

from dataclasses import dataclass
from functools import cache
from math import hypot, sqrt

import numpy as np

from motord.experiments.torque_speed.power_series import PowerSeries
from motord.experiments.torque_speed.turns import CapturedTurns
from motord.intervals import LEVEL

LEAST_BLOCKS = 4
"""Blocks of turns from which on their scatter is a standard error."""

CORRELATION_MAX = 0.8
"""Largest correlation of successive blocks that is allowed for."""

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
    freedom: float
    drift: float
    drift_stderr: float


def scatter_of(values: np.ndarray) -> Scatter:
    """Return the standard error of the mean of successive blocks (g,), LEAST_BLOCKS or more."""
    number = values.size
    place = np.arange(number) - (number - 1) / 2
    slope = float(place @ values / (place @ place))
    rest = values - values.mean() - slope * place
    variance = float(rest @ rest) / (number - 2)
    rho = float(rest[1:] @ rest[:-1]) / float(rest @ rest) if variance > 0 else 0.0
    rho = min(max(rho + (1 + 3 * rho) / number, 0.0), CORRELATION_MAX)
    inflated = variance * (1 + rho) / (1 - rho)
    return Scatter(
        stderr=sqrt(inflated / number),
        freedom=max((number - 2) * (1 - rho**2) / (1 + rho**2), 1.0),
        drift=slope * (number - 1),
        drift_stderr=(number - 1) * sqrt(inflated / float(place @ place)),
    )


@dataclass(frozen=True)
class ErrorSum:
    """Errors of a quantity that add: rectangular half-widths, slow readings, and the scatter."""

    rectangular: tuple[float, ...]
    sampling: float
    scatter: Scatter

    @property
    def stderr(self) -> float:
        """Combined standard uncertainty (JCGM 100)."""
        return hypot(self.sampling, self.scatter.stderr, *(a / sqrt(3) for a in self.rectangular))

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval, from draws of the sum (JCGM 101)."""
        uniform, normal = _draws(len(self.rectangular))
        total = np.asarray(self.rectangular) @ uniform + self.sampling * normal
        total += self.scatter.stderr * _student(min(int(self.scatter.freedom), FREEDOM_MAX))
        return float(np.quantile(np.abs(total), LEVEL))


@cache
def _draws(sources: int) -> tuple[np.ndarray, np.ndarray]:
    """Return uniform draws (sources, d) of -1 to 1, and normal ones (d,)."""
    rng = np.random.default_rng(1)
    return rng.uniform(-1.0, 1.0, (sources, DRAWS)), rng.standard_normal(DRAWS)


@cache
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
