"""The joint estimator: alpha, beta and one cogging torque for all operating points, at once.

A weighted least squares with instruments. alpha's torque grows with the set-point, cogging does
not, and beta's torque has other orders: fitted together they are separated, which the residual
estimator cannot do. A turn weighs 1 / s_j^2, s_j^2 the mean of the squares that the round before
left unexplained in the turns of its operating point j. Star-connected motors add Kirchhoff's law,
sum_p (alpha_p i*_p + beta_p) = 0.
"""

from dataclasses import dataclass

import numpy as np

from motord.experiments.calibration.estimate.least_squares.deviations import PointScores
from motord.experiments.calibration.estimate.least_squares.identifiability import (
    Identifiability,
    assess,
    unit_product,
)
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    DELAY,
    NormalEquations,
    Regression,
    prior_information,
)
from motord.experiments.calibration.estimate.least_squares.scatter import errors
from motord.identification import IdentifyError
from motord.identification.cluster_robust_ls import equilibrated
from motord.identification.variance_components import VarianceComponents

ITERATIONS = 4
"""Rounds of weighting: the weights follow from what the last round left unexplained."""

SINGULAR = 1e-9
"""Part of the largest singular value of normal equations below which one is rounding."""

NEARLY_SEEN = "a common gain or offset that is nearly seen"
"""Source of errors: how far the solution that leaves it open lies away."""

NO_GAINS = (
    "no gains fit this torque: are two phases swapped, the encoder's direction or the sign of the "
    "torque the other one, the encoder's lines broken, or the back-EMF wrong? `motord plan start "
    "align` finds phase_order, encoder_direction and encoder_offset_rad"
)
"""Why there are no gains."""


@dataclass(frozen=True)
class Solution:
    """What the fit gave. theta (p,): delta epsilon alpha, delta beta, age, zoh, delta cogging."""

    theta: np.ndarray
    alpha: np.ndarray
    delta_epsilon: float

    @property
    def vector(self) -> np.ndarray:
        """Return theta with alpha in place of its first, and delta epsilon, in one (p + 1,)."""
        return np.concatenate([self.alpha, self.theta[ALPHA.stop :], [self.delta_epsilon]])


@dataclass(frozen=True)
class JointFit:
    """A solution with what it rests on.

    errors: of solution.vector (p + 1,); noise_Nm (points,): standard deviation that is
    left in each operating point; condition_number of what was solved, columns scaled alike;
    delay_unit_s: unit of the age of the currents; torque_information (points, p, p),
    law_information (p, p): on theta, by that noise, of the torque and of Kirchhoff's law.
    derivative (p + 1, p): of solution.vector by theta on what is seen; gain_shift (p + 1,): the
    same by the common gain, for each part by which it is not the 1 that is assumed; 0 where it is
    seen.
    """

    solution: Solution
    errors: VarianceComponents
    identifiable: Identifiability
    noise_Nm: np.ndarray
    condition_number: float
    delay_unit_s: float
    torque_information: np.ndarray
    law_information: np.ndarray
    derivative: np.ndarray
    gain_shift: np.ndarray

    @property
    def by_white_noise(self) -> np.ndarray:
        """Covariance of solution.vector (p + 1, p + 1), were the residual in each point white."""
        left = self.torque_information.sum(axis=0) + self.law_information + self.prior
        inverse = inverse_on_seen((left + left.T) / 2, self.identifiable)
        by_theta = derivative(left, self.solution, self.identifiable)
        return np.asarray(by_theta @ inverse @ by_theta.T)

    @property
    def prior(self) -> np.ndarray:
        """Information on theta before any data (p, p)."""
        return prior_information(self.solution.theta.size)

    @property
    def current_delay_s(self) -> tuple[float, float, float]:
        """By how much the currents are older than the recording says, its standard error, and the
        degrees of freedom of that."""
        stderr_s = float(self.stderr[DELAY]) * self.delay_unit_s
        delay_s = float(self.solution.theta[DELAY]) * self.delay_unit_s
        return delay_s, stderr_s, float(self.errors.freedom[DELAY])

    @property
    def stderr(self) -> np.ndarray:
        """Standard errors of solution.vector."""
        return self.errors.stderr


def fit(regression: Regression, rated_A: float, *, use_law: bool = True) -> JointFit:
    """Fit all turns. rated_A: peak of the rated current; use_law: use Kirchhoff's law, if it holds.

    Raises IdentifyError where the turns cannot separate the parameters.
    """
    turns = regression.sums(np.ones(3))
    weight, kirchhoff_weight = 1 / turns.mean_by_point(turns.yy), 0.0
    one = np.ones(1)
    normals = turns.total(weight).normals(one, kirchhoff_weight, np.zeros(turns.xy.shape[1]))
    theta = minimum_norm_solution(normals.left, normals.right.sum(axis=0))
    weight = 1 / turns.mean_by_point(turns.unexplained(theta))
    normals = turns.total(weight).normals(one, kirchhoff_weight, theta)
    identifiable = assess(normals.information, normals.torque_information, rated_A)
    for _ in range(ITERATIONS):
        solution = solve(normals.left, normals.right.sum(axis=0), identifiable)
        turns = regression.sums(solution.theta[ALPHA])
        variance = turns.mean_by_point(turns.unexplained(solution.theta))
        weight = 1 / variance
        kirchhoff_weight = turns.kirchhoff_weight(solution.theta) if use_law else 0.0
        theta = solution.theta
        normals = turns.total(weight).normals(one, kirchhoff_weight, theta)
        identifiable = assess(normals.information, normals.torque_information, rated_A)
    normals = turns.normals(weight, kirchhoff_weight, theta)
    solution = solve(normals.left, normals.right.sum(axis=0), identifiable)
    first_turns = np.unique(turns.point, return_index=True)[1]
    return JointFit(
        solution=solution,
        errors=stated_errors(normals, turns.point, solution, identifiable),
        identifiable=identifiable,
        noise_Nm=np.sqrt(variance[first_turns]),
        condition_number=_condition_number(normals.information, identifiable),
        delay_unit_s=turns.delay_unit_s,
        torque_information=np.add.reduceat(normals.torque, first_turns),
        law_information=normals.information - normals.torque_information,
        derivative=derivative(normals.left, solution, identifiable),
        gain_shift=_gain_shift(normals.left, solution, identifiable),
    )


def stated_errors(
    normals: NormalEquations, point: np.ndarray, solution: Solution, identifiable: Identifiability
) -> VarianceComponents:
    """Return the errors of the solution's vector.

    Where something was fixed that the data show nearly well enough, they are the wider of both:
    those of the solution that leaves it open, and how far that lies away.
    """
    if identifiable.gain_nearly or identifiable.offset_nearly:
        opened = identifiable.opened()
        other = solve(normals.left, normals.right.sum(axis=0), opened)
        apart = other.vector - solution.vector
        return stated_errors(normals, point, other, opened) + VarianceComponents.known(
            np.outer(apart, apart), NEARLY_SEEN
        )
    inverse = inverse_on_seen(normals.left, identifiable)
    scores = PointScores.of(normals, point, solution.theta, inverse)
    influence = derivative(normals.left, solution, identifiable) @ inverse
    return errors(scores, solution.theta[ALPHA], influence, normals.prior, identifiable)


def solve(normal: np.ndarray, right: np.ndarray, identifiable: Identifiability) -> Solution:
    """Solve normal equations (p, p), (p,) with what is not seen fixed. Raises IdentifyError."""
    subspace = identifiable.subspace(right.size)
    fixed = identifiable.gain_vector(right.size)
    sides = subspace.T @ np.column_stack([right, normal @ fixed])
    try:
        found = subspace @ np.linalg.solve(subspace.T @ normal @ subspace, sides)
    except np.linalg.LinAlgError:
        raise IdentifyError(
            "these operating points do not separate alpha, beta and cogging; "
            "take more torques and more turns"
        ) from None
    if not np.isfinite(found).all():
        raise IdentifyError(
            "the samples hold currents or torques that no motor has; look at the recording's "
            "currents and torque, and at what `record info --check` says of it"
        )
    theta = found[:, 0]
    if identifiable.gain_direction is None:
        delta_epsilon = float(np.cbrt(theta[ALPHA].prod()))
        return Solution(theta, theta[ALPHA] / delta_epsilon, delta_epsilon)
    change = fixed - found[:, 1]
    share = unit_product(theta[ALPHA], change[ALPHA])
    if np.isnan(share):
        raise IdentifyError(NO_GAINS)
    theta = theta + share * change
    return Solution(theta, theta[ALPHA], 1.0)


def minimum_norm_solution(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the parameters (p,) of least norm that normal equations (p, p), (p,) have.

    What they leave of the torque is the noise by which to judge what is seen. A common gain that is
    far from 1, such as that of a torque with the other sign, would leave much more where it is
    taken for 1, and so count as unseen.
    """
    scaled, scale = equilibrated(normal)
    inverse = np.linalg.pinv(scaled, rcond=SINGULAR)
    return np.asarray(scale * (inverse @ (scale * right)))


def inverse_on_seen(normal: np.ndarray, identifiable: Identifiability) -> np.ndarray:
    """Return the inverse of (p, p) on what is seen, as `solve` uses it."""
    subspace = identifiable.subspace(len(normal))
    return np.asarray(subspace @ np.linalg.solve(subspace.T @ normal @ subspace, subspace.T))


def derivative(normal: np.ndarray, solution: Solution, identifiable: Identifiability) -> np.ndarray:
    """Return the derivative of the solution's vector by theta on what is seen (p + 1, p)."""
    size, slopes = len(normal), 1 / solution.theta[ALPHA]
    found = np.eye(size + 1, size)
    if identifiable.gain_direction is None:
        found[-1, ALPHA] = solution.delta_epsilon * slopes / 3
        found[ALPHA, ALPHA] /= solution.delta_epsilon
        found[ALPHA, ALPHA] -= np.outer(solution.alpha, slopes) / 3
        return found
    change = _unseen_change(normal, identifiable)
    found[:-1, ALPHA] -= np.outer(change, slopes) / (slopes @ change[ALPHA])
    return found


def _unseen_change(normal: np.ndarray, identifiable: Identifiability) -> np.ndarray:
    """Return how theta (p,) changes along what the data do not show of the gains."""
    fixed = identifiable.gain_vector(len(normal))
    return np.asarray(fixed - inverse_on_seen(normal, identifiable) @ (normal @ fixed))


def _gain_shift(
    normal: np.ndarray, solution: Solution, identifiable: Identifiability
) -> np.ndarray:
    """Return by how much the vector (p + 1,) would change, if delta epsilon were 1 + e, over e.

    The gains, whose product is then (1 + e)^3, go along what is not seen; alpha has the product 1.
    """
    shift = np.zeros(len(normal) + 1)
    if identifiable.gain_direction is not None:
        change = _unseen_change(normal, identifiable)
        shift[:-1] = 3 * change / (change[ALPHA] / solution.theta[ALPHA]).sum()
        shift[ALPHA] -= solution.alpha
        shift[-1] = 1.0
    return shift


def _condition_number(information: np.ndarray, identifiable: Identifiability) -> float:
    subspace = identifiable.subspace(information.shape[0])
    scaled, _ = equilibrated(subspace.T @ information @ subspace)
    values = np.linalg.eigvalsh(scaled)
    return float(np.sqrt(values[-1] / values[0])) if values[0] > 0 else float("inf")
