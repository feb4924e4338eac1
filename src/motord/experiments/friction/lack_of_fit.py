"""Lack of fit of the coast-downs of one direction: a torque with the square of the speed.

How coast-downs differ says nothing of what the model lacks in all of them alike, such as windage,
s W q'^2. Next to a Coulomb and a viscous part of its own each coast-down gives a coefficient
W_g/J; their mean, by information, is tested by t with one degree of freedom less than there are
coast-downs. Friction that differs from one to the next does not matter to it. What a column x of
coefficient W/J, left out, adds to the fitted figures is what the fit makes of x W/J as values.
"""

from dataclasses import dataclass

import numpy as np

from motord.experiments.friction.coast_down_fit import CoastDownFit
from motord.experiments.friction.two_step_fit import OWN, TwoStepFit, bases, partialled_out
from motord.intervals import t_quantile

LEVEL = 0.002
"""Probability of a finding by chance, in each direction."""

ROUNDING = 1e-9
"""Of Coulomb friction, at the highest speed: less is of the arithmetic, in data without noise."""


@dataclass(frozen=True)
class WindageFit:
    """A part of the square of the speed that the model does not have, over the inertia.

    coefficient: W/J; limit: what chance alone makes of it; half: of its 95 % interval;
    moved (p,): by how much each coefficient of the fit changes with one of W/J.
    """

    coefficient: float
    limit: float
    half: float
    moved: np.ndarray

    @property
    def significant(self) -> bool:
        """Whether it is beyond what chance makes."""
        return abs(self.coefficient) > self.limit

    def changes(self, weights: np.ndarray, direct: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return by how much weights @ coefficients (m,) would change, and half of its interval.

        weights (m, p) or (p,); direct: what one of W/J adds besides.
        """
        moved = np.asarray(weights @ self.moved + direct)
        return moved * self.coefficient, np.abs(moved) * self.half

    def widened(
        self, half: np.ndarray | float, weights: np.ndarray, scale: float = 1.0, direct: float = 0.0
    ) -> np.ndarray:
        """Return halves of intervals (m,) of scale times weights @ coefficients, with the change.

        They hold what allowing for the part gives and the interval of that, where it is there.
        """
        if not self.significant:
            return np.asarray(half)
        change, more = self.changes(weights, direct)
        return np.asarray(scale * np.abs(change) + np.hypot(half, scale * more))


def lack_of_fit(
    group: CoastDownFit, speed_rad_s: np.ndarray, at_rad_s: float, scale: float
) -> WindageFit:
    """Return the part of the square of the speed next to a fit, with a Stribeck part or without.

    speed_rad_s (n,): of the rows; at_rad_s, scale: w_s and S/J of that part, 0 for none.
    """
    columns = group.columns
    if at_rad_s:
        columns = np.hstack([columns, group.stribeck(speed_rad_s, at_rad_s, scale)])
    square = group.rows.projected(group.rows.windage(speed_rad_s))
    own = np.column_stack([columns[:, :OWN], square])
    coefficients, information = _of_each(own, columns[:, OWN:], group.values, group.rows.first)
    weight = information / information.sum()
    mean = float(weight @ coefficients)
    number = len(group.rows.coasts)
    variance = float((weight**2 * (coefficients - mean) ** 2).sum()) * number / (number - 1)
    fastest_rad_s = float(speed_rad_s.max())
    rounding = ROUNDING * abs(float(group.fit.solution[0])) / fastest_rad_s**2
    stderr = max(float(np.sqrt(variance)), rounding)
    return WindageFit(
        mean,
        t_quantile(1 - LEVEL / 2, number - 1) * stderr,
        t_quantile(0.975, number - 1) * stderr,
        -TwoStepFit.of(columns, group.rows.first, square).solution,
    )


def windage_instead(
    group: CoastDownFit, speed_rad_s: np.ndarray, at_rad_s: float, scale: float
) -> bool:
    """Return whether a part of the square of the speed explains what a Stribeck part would.

    By the Bayesian information criterion, the latter with its w_s having a parameter more.
    """
    square = group.rows.projected(group.rows.windage(speed_rad_s))
    stribeck = group.stribeck(speed_rad_s, at_rad_s, scale)
    by_square, by_stribeck = (
        max(group.residual_squares(more), 1e-300) for more in (square[:, None], stribeck)
    )
    number = group.values.size
    return bool(number * np.log(by_square / by_stribeck) < np.log(number))


def _of_each(
    own: np.ndarray, common: np.ndarray, values: np.ndarray, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficient of the last own column (g,), and its information.

    Each coast-down has coefficients of its own columns; those of the others are common to all.
    """
    own_bases = bases(own, first)
    partial, partial_values = (partialled_out(own_bases, x, first) for x in (common, values))
    shared = np.linalg.lstsq(partial, partial_values)[0] if common.shape[1] else np.zeros(0)
    found = []
    less_common = np.split(values - common @ shared, first[1:])
    for x, y in zip(np.split(own, first[1:]), less_common, strict=True):
        q, r = np.linalg.qr(x)
        found.append((q[:, -1] @ y / r[-1, -1], r[-1, -1] ** 2))
    coefficients, information = np.array(found).T
    return coefficients, information
