"""Standard errors from successive blocks of turns, 95 % intervals of sums of errors, and sampling.

A block's error may depend on that of the block before (first-order autoregression):

    se^2 = s^2 / G (1 + rho) / (1 - rho),    freedom = (G - 2) (1 - rho^2) / (1 + rho^2)

with s the scatter about a straight line over the G blocks: a drift belongs to what is measured.
"""

from collections.abc import Sequence
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

LEAST_SCATTER = 0.4
"""Part of the scatter's standard error that remains, whatever is taken off it."""

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
class Sampling:
    """What slow readings do to a mean power: its standard error, and the one that scatter shows.

    The scatter of blocks of turns counts each of them as by chance, and shows more than the error
    where the readings fall evenly over the angles; where they are in step with the rotor, nothing.
    """

    stderr_W: float
    in_scatter_W: float


@dataclass(frozen=True)
class ErrorSum:
    """Errors of a quantity that add: rectangular half-widths, slow readings, and the scatter.

    sampling: of the readings, in the unit of the quantity; what the scatter shows of it is taken
    off the scatter, but for LEAST_SCATTER of it.
    """

    rectangular: tuple[float, ...]
    sampling: float
    sampling_in_scatter: float
    scatter: Scatter

    @property
    def scatter_stderr(self) -> float:
        """Standard error by the scatter, without what slow readings make of it."""
        left = self.scatter.stderr**2 - self.sampling_in_scatter**2
        return max(sqrt(max(left, 0.0)), LEAST_SCATTER * self.scatter.stderr)

    @property
    def stderr(self) -> float:
        """Combined standard uncertainty (JCGM 100)."""
        return hypot(self.sampling, self.scatter_stderr, *(a / sqrt(3) for a in self.rectangular))

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval, from draws of the sum (JCGM 101)."""
        uniform, normal = _draws(len(self.rectangular))
        total = np.asarray(self.rectangular) @ uniform + self.sampling * normal
        total += self.scatter_stderr * _student(min(int(self.scatter.freedom), FREEDOM_MAX))
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


def sampling_of(turns: CapturedTurns, series: PowerSeries, edges_s: np.ndarray) -> Sampling:
    """Return what slow readings do to the mean power between the first and the last edge (g + 1,).

    The power's course over the ticks is read as the series is, each reading up to half a period
    away from its time, and blocks between the edges are made of it. With that, readings in step
    with the rotor show, and a time that a reading may be late.
    """
    course = _continued(turns, series)
    ends_s = edges_s[[0, -1]]
    true_W = course.means_W(ends_s)[0]
    errors_W, stderrs_W = [], []
    for part in (np.arange(SHIFTS) + 0.5) / SHIFTS - 0.5:
        at_s = series.t_s + part * series.period_s
        if series.means:
            read_W = np.concatenate([[0.0], course.means_W(at_s)])
        else:
            read_W = np.interp(at_s, course.t_s, course.power_W)
        read = PowerSeries(series.t_s, read_W, series.means)
        errors_W.append(float(read.means_W(ends_s)[0] - true_W))
        stderrs_W.append(scatter_of(read.means_W(edges_s)).stderr)
    seen_W = _root_mean_square(stderrs_W) if turns.electrical else 0.0
    return Sampling(_root_mean_square(errors_W), seen_W)


def _root_mean_square(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _continued(turns: CapturedTurns, series: PowerSeries) -> PowerSeries:
    """Return the power's course by tick, a period longer than the readings at either end.

    Beyond the capture the rotor is taken to go on as it did.
    """
    step_s = float(np.median(np.diff(turns.t_s)))
    begin_s, end_s = turns.t_s[turns.edges[[0, -1]]]
    turn_s = (end_s - begin_s) / (turns.edges.size - 1)
    first_s = min(series.t_s[0] - series.period_s, begin_s)
    t_s = np.arange(first_s, max(series.t_s[-1] + series.period_s, end_s) + step_s, step_s)
    inside_s = t_s + turn_s * np.ceil(np.maximum(turns.t_s[0] - t_s, 0) / turn_s)
    inside_s -= turn_s * np.ceil(np.maximum(t_s - turns.t_s[-1], 0) / turn_s)
    return PowerSeries(t_s, np.interp(inside_s, turns.t_s, turns.course_W), means=False)
