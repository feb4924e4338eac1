"""The joint estimator: alpha, beta and one cogging torque for all operating points, at once.

A weighted least squares with instruments. alpha's torque grows with the set-point, cogging does
not, and beta's torque has other orders: fitted together they are told apart, which the residual
estimator cannot do. Star-connected motors add Kirchhoff's law, sum_p (alpha_p i*_p + beta_p) = 0.
"""

from dataclasses import dataclass

import numpy as np

from motord.identify import IdentifyError
from motord.identify.basis import ALPHA, FIRST_COGGING
from motord.identify.gauge import COMMON, Gauge, decide, unit_product
from motord.identify.turns import Normals, Turns

ITERATIONS = 4
"""Rounds of weighting: the weights follow from what the last round left unexplained."""


@dataclass(frozen=True)
class Solution:
    """What the fit gave. theta (p,): delta epsilon alpha, delta beta, delta cogging cos, sin."""

    theta: np.ndarray
    alpha: np.ndarray
    delta_epsilon: float

    @property
    def vector(self) -> np.ndarray:
        """Return alpha, beta, cogging and delta epsilon in one vector (p + 1,)."""
        return np.concatenate([self.alpha, self.theta[FIRST_COGGING - 3 :], [self.delta_epsilon]])


@dataclass(frozen=True)
class Fit:
    """A solution with what it rests on.

    covariance (p + 1, p + 1) of solution.vector; noise_Nm (points,): standard deviation that is
    left in each operating point; condition_number of what was solved, columns scaled alike.
    """

    solution: Solution
    covariance: np.ndarray
    gauge: Gauge
    noise_Nm: np.ndarray
    condition_number: float

    @property
    def stderr(self) -> np.ndarray:
        """Standard errors of solution.vector."""
        errors: np.ndarray = np.sqrt(np.diag(self.covariance))
        return errors


def fit(turns: Turns, rated_A: float, *, use_law: bool = True) -> Fit:
    """Fit all turns. rated_A: peak of the rated current; use_law: use Kirchhoff's law, if it holds.

    Raises IdentifyError where the turns cannot tell the parameters apart.
    """
    weight, law_weight = 1 / turns.mean_by_point(turns.yy), 0.0
    gauge = Gauge(COMMON, offset_seen=False)
    for _ in range(ITERATIONS):
        normals = turns.normals(weight, law_weight)
        solution = solve(normals.torque.sum(0) + normals.law.sum(0), normals.right.sum(0), gauge)
        variance = turns.mean_by_point(turns.unexplained(solution.theta))
        weight = 1 / variance
        law_weight = turns.law_weight(solution.theta) if use_law else 0.0
        normals = turns.normals(weight, law_weight)
        gauge = decide(normals.information, normals.torque_information, rated_A)
    return Fit(
        solution=solve(normals.torque.sum(0) + normals.law.sum(0), normals.right.sum(0), gauge),
        covariance=_jackknife(normals, gauge),
        gauge=gauge,
        noise_Nm=np.sqrt(variance[np.unique(turns.point, return_index=True)[1]]),
        condition_number=_condition_number(normals.information, gauge),
    )


def solve(normal: np.ndarray, right: np.ndarray, gauge: Gauge) -> Solution:
    """Solve normal equations (p, p), (p,) with what is not seen fixed. Raises IdentifyError."""
    subspace = gauge.subspace(right.size)
    fixed = gauge.gain_vector(right.size)
    sides = subspace.T @ np.column_stack([right, normal @ fixed])
    try:
        found = subspace @ np.linalg.solve(subspace.T @ normal @ subspace, sides)
    except np.linalg.LinAlgError:
        raise IdentifyError(
            "these operating points do not tell alpha, beta and cogging apart; "
            "take more torques and more turns"
        ) from None
    theta = found[:, 0]
    if gauge.gain_direction is None:
        delta_epsilon = float(np.cbrt(theta[ALPHA].prod()))
        return Solution(theta, theta[ALPHA] / delta_epsilon, delta_epsilon)
    change = fixed - found[:, 1]
    theta = theta + unit_product(theta[ALPHA], change[ALPHA]) * change
    return Solution(theta, theta[ALPHA], 1.0)


def _jackknife(normals: Normals, gauge: Gauge) -> np.ndarray:
    """Return the covariance of the solution's vector from leaving out one turn at a time.

    Turns are the blocks: whatever colour the noise has within a turn is accounted for.
    """
    lefts, rights = normals.torque + normals.law, normals.right
    left, right = lefts.sum(axis=0), rights.sum(axis=0)
    without = np.array(
        [
            solve(left - one, right - its, gauge).vector
            for one, its in zip(lefts, rights, strict=True)
        ]
    )
    spread = without - without.mean(axis=0)
    covariance: np.ndarray = (len(without) - 1) / len(without) * spread.T @ spread
    return covariance


def _condition_number(information: np.ndarray, gauge: Gauge) -> float:
    subspace = gauge.subspace(information.shape[0])
    seen = subspace.T @ information @ subspace
    scale = 1 / np.sqrt(np.maximum(np.diag(seen), 1e-300))
    values = np.linalg.eigvalsh(seen * np.outer(scale, scale))
    return float(np.sqrt(values[-1] / values[0])) if values[0] > 0 else float("inf")
