"""Lack of fit of the coast-downs of one direction: a torque with the square of the speed.

How coast-downs differ says nothing of what the model lacks in all of them alike, such as windage,
s W q'^2. Its column is one more that they have in common, next to cogging torque and a Stribeck
part; with Coulomb and viscous friction of each coast-down its own, what friction differs by does
not matter to it. W/J is tested by t, its variance by how coast-downs differ (CR2), or that of white
noise, if that is more: few may be alike by chance. An error of the cogging torque, which all have
alike, is in it. What a column x of coefficient W/J, left out, adds to the fitted figures is what
the fit makes of x W/J as values.
"""

from dataclasses import dataclass

import numpy as np

from motord.experiments.friction.coast_down_fit import CoastDownFit
from motord.experiments.friction.two_step_fit import TwoStepFit
from motord.identification.cluster_robust_ls import Regressors
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
    def possible(self) -> bool:
        """Whether its 95 % interval is without 0: it may be there, however seldom it is named."""
        return abs(self.coefficient) > self.half

    def changes(self, weights: np.ndarray, direct: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return by how much weights @ coefficients (m,) would change, and half of its interval.

        weights (m, p) or (p,); direct: what one of W/J adds besides.
        """
        moved = np.asarray(weights @ self.moved + direct)
        return moved * self.coefficient, np.abs(moved) * self.half

    def widened(
        self, half: np.ndarray | float, weights: np.ndarray, direct: float = 0.0
    ) -> np.ndarray:
        """Return halves of intervals (m,) of weights @ coefficients, with the change.

        They hold what allowing for the part gives and the interval of that, where it may be there.
        """
        if not self.possible:
            return np.asarray(half)
        change, more = self.changes(weights, direct)
        return np.asarray(np.abs(change) + np.hypot(half, more))


def lack_of_fit(
    group: CoastDownFit, speed_rad_s: np.ndarray, at_rad_s: float, scale: float
) -> WindageFit:
    """Return the part of the square of the speed next to a fit, with a Stribeck part or without.

    speed_rad_s (n,): of the rows; at_rad_s, scale: w_s and S/J of that part, 0 for none.
    """
    own, more, square = group.fit.own, group.common, group.windage(speed_rad_s)
    if at_rad_s:
        more = np.hstack([more, group.stribeck(speed_rad_s, at_rad_s, scale)])
    regressors = Regressors.of(own.partialled_out(np.hstack([more, square])), own.first)
    fit = regressors.fit_bias_reduced(own.partialled_out(group.values))
    last = np.eye(fit.solution.size)[-1]
    freedom = min(fit.freedom(last), own.first.size - 1.0)
    rounding = ROUNDING * abs(float(group.fit.solution[0])) / float(speed_rad_s.max()) ** 2
    white = fit.noise * np.sqrt(regressors.inverse[-1, -1])
    stderr = max(float(np.sqrt(fit.covariance[-1, -1])), float(white), rounding)
    return WindageFit(
        float(fit.solution[-1]),
        t_quantile(1 - LEVEL / 2, freedom) * stderr,
        t_quantile(0.975, freedom) * stderr,
        -TwoStepFit.with_common(own, more, square[:, 0]).solution,
    )


def windage_instead(
    group: CoastDownFit, speed_rad_s: np.ndarray, at_rad_s: float, scale: float
) -> bool:
    """Return whether a part of the square of the speed explains what a Stribeck part would.

    By the Bayesian information criterion, the latter with its w_s having a parameter more.
    """
    square = group.windage(speed_rad_s)
    stribeck = group.stribeck(speed_rad_s, at_rad_s, scale)
    by_square, by_stribeck = (
        max(group.residual_squares(more), 1e-300) for more in (square, stribeck)
    )
    number = group.values.size
    return bool(number * np.log(by_square / by_stribeck) < np.log(number))
