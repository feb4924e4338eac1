"""The ripple that the uncertainty of the parameters leaves, once the calibration is applied.

With errors e of gains, offsets and cogging torque, the currents of set-point T leave, to first
order (docs/methods.md, 8),

    -sum_p (e_alpha,p / alpha_p + e_delta / delta) (i_p - beta_p) k_p - sum_p e_beta,p k_p - e_cog,
    i_p = (T - tau_cog) w_p

with the torque's mean taken out. In a star k_p - sum_q alpha_q k_q / sum_q alpha_q stands for k_p:
what does not add up to nothing is taken up in proportion to the gains. So the mean square over the
turn is e' Q e, and its mean trace(Q cov e). It is linear in T: any number of set-points costs no
more than one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig
from motord.experiments.calibration.estimate.joint_result import cogging_harmonics, result_of
from motord.experiments.calibration.estimate.least_squares.joint import JointFit, Solution
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    FIRST_COGGING,
    Regression,
)
from motord.identification.least_loss import currents_per_Nm
from motord.identification.variance_components import VarianceComponents
from motord.intervals import LEVEL, coverage_factor, f_quantile

MARGIN = 1.25
"""Factor on half-widths by white noise. Stopping where an estimated error is small picks those that
are too small; white noise makes hardly an accident, so what it alone makes decides as well."""


@dataclass(frozen=True)
class PredictedRipple:
    """RMS ripple over turn and set-points, percent of rated torque.

    percent: root of the mean square that the errors' covariance makes; upper_percent: the ripple
    is below it with a probability of 95 %.
    """

    percent: float
    upper_percent: float

    @classmethod
    def of(cls, errors: VarianceComponents, form: np.ndarray) -> "PredictedRipple":
        """Return the ripple of errors of Solution.vector; form (p + 1, p + 1): `ripple_form`.

        e' Q e is taken for a chi-square of 2 m^2 / var degrees of freedom (Satterthwaite), over
        an estimate of its mean m that has degrees of freedom of its own: F distributed.
        """
        mean, freedom = errors.trace(form)
        if mean <= 0:
            return cls(0.0, 0.0)
        product = form @ errors.covariance
        own = max(mean**2 / max(float((product * product.T).sum()), 1e-300), 1.0)
        factor = f_quantile(LEVEL, own, freedom)
        return cls(float(np.sqrt(mean)), float(np.sqrt(factor * mean)))


def half_widths_of(
    fitted: JointFit, regression: Regression, motor: MotorConfig, torques_Nm: Sequence[float]
) -> dict[str, float]:
    """Return a fit's half-widths for targets: no departure of the bench is looked for.

    ripple_percent: what errors of the calibration will leave at set-points torques_Nm, with a
    probability of 95 %.
    """
    harmonics = cogging_harmonics(fitted, regression)
    stated = result_of(fitted, harmonics, [], [], motor.counts).target_half_widths
    white = MARGIN * coverage_factor() * np.sqrt(np.diag(fitted.by_white_noise))
    least = {
        "alpha_percent": float(100 * (white[ALPHA] / fitted.solution.alpha).max()),
        "beta_A": float(white[BETA].max()),
    }
    found = {name: max(value, least.get(name, 0.0)) for name, value in stated.items()}
    form = ripple_form(fitted.solution, regression.cogging_orders, motor, torques_Nm)
    ripple = PredictedRipple.of(fitted.errors, form)
    return {**found, "ripple_percent": ripple.upper_percent}


def ripple_form(
    solution: Solution, orders: Sequence[int], motor: MotorConfig, torques_Nm: Sequence[float]
) -> np.ndarray:
    """Return Q (p + 1, p + 1), percent^2: e' Q e of errors e of `solution.vector`.

    The mean over the set-points.
    """
    ripple = _unit_ripple(solution, orders, motor)
    products = (ripple @ ripple.T).reshape(2, len(ripple) // 2, 2, -1)
    still, per_Nm, cross = products[0, :, 0], products[1, :, 1], products[0, :, 1]
    squares = still + np.mean(torques_Nm) * (cross + cross.T)
    squares = squares + np.mean(np.square(torques_Nm)) * per_Nm
    return np.asarray(squares * (100 / motor.rated_torque_Nm) ** 2 / ripple.shape[1])


def _unit_ripple(solution: Solution, orders: Sequence[int], motor: MotorConfig) -> np.ndarray:
    """Return the torque of unit errors over the turn: at no torque, then per Nm, without means.

    Shape (2 (p + 1), counts).
    """
    k, w = motor.back_emf_table().T, currents_per_Nm(motor).T
    if motor.connection == "star":
        k = k - solution.alpha @ k / solution.alpha.sum()
    turned_rad = np.outer(orders, 2 * np.pi * np.arange(motor.counts) / motor.counts)
    waves = np.stack([np.cos(turned_rad), np.sin(turned_rad)], axis=1).reshape(-1, motor.counts)
    cogging_Nm = solution.theta[FIRST_COGGING:] @ waves
    ripple = np.zeros((2, solution.vector.size, motor.counts))
    still, per_Nm = ripple
    still[ALPHA] = k * (cogging_Nm * w + solution.theta[BETA, None])
    per_Nm[ALPHA] = -k * w
    still[BETA] = -k
    still[FIRST_COGGING:-1] = -waves
    ripple[:, -1] = ripple[:, ALPHA].sum(axis=1) / solution.delta_epsilon
    ripple[:, ALPHA] /= solution.alpha[:, None]
    ripple -= ripple.mean(axis=2, keepdims=True)
    return ripple.reshape(-1, motor.counts)
