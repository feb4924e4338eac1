"""The Cramer-Rao bound of a calibration, its efficiency, and what holds it back.

Information of a turn is X'X / sigma^2, with X what the instruments explain of the model's columns
and sigma the white noise of a sample (`white_noise`); Kirchhoff's law and the priors on the age of
the currents and the zero-order hold add theirs:

    cov >= (sum over turns of X'X / sigma^2 + law / sigma_law^2 + prior)^-1

on the subspace of what is seen. The efficiency of a quantity is the bound over the stated variance,
that of the predicted ripple trace(Q bound) / trace(Q cov) (`predicted_ripple`). The stated variance
has been estimated: of few turns, an efficiency may come out above 1.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from motord.calibration import BoundedQuantity, CramerRao, VarianceShare
from motord.calibration.cramer_rao import PRIORS, WHITE_NOISE
from motord.config import MotorConfig, TorqueSensorConfig
from motord.experiments.calibration.estimate.lack_of_fit.analysis import FitResidual, LackOfFit
from motord.experiments.calibration.estimate.least_squares import scatter
from motord.experiments.calibration.estimate.least_squares.joint import (
    NEARLY_SEEN,
    JointFit,
    derivative,
    inverse_on_seen,
)
from motord.experiments.calibration.estimate.least_squares.kirchhoff import Kirchhoff
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    FIRST_COGGING,
)
from motord.experiments.calibration.estimate.predicted_ripple import PredictedRipple, ripple_form
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.calibration.estimate.white_noise import LEAST, WhiteNoise
from motord.identification.variance_components import VarianceComponents

COLOUR = "colour of the noise within turns"
WEIGHTS = "weights of the operating points"
FINDINGS = "findings"


@dataclass(frozen=True)
class Bound:
    """Covariances of Solution.vector (p + 1, p + 1) that the white noise makes.

    white, prior: their sum is the bound; weighted: white noise with the weights of the fit.
    """

    white: np.ndarray
    prior: np.ndarray
    weighted: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """The Cramer-Rao bound."""
        return np.asarray(self.white + self.prior)


def cramer_rao(
    result: CalibrationResult,
    fitted: JointFit,
    residual: FitResidual,
    left: LackOfFit,
    agreement: Kirchhoff | None,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
) -> CramerRao:
    """Return bound and efficiency; result: its harmonics as the fit's parameters follow."""
    regression = residual.regression
    noise = WhiteNoise.of(residual, fitted, sensor)
    bound = _bound(fitted, noise)
    torques_Nm = [point.torque_set_Nm for point in regression.points]
    orders = regression.basis.orders[: regression.orders]
    form = ripple_form(fitted.solution, orders, motor, torques_Nm)
    findings = _of_findings(result, fitted, left, agreement, form)
    errors = fitted.errors + VarianceComponents.known(findings, FINDINGS)
    ripple = PredictedRipple.of(errors, form)
    return CramerRao(
        white_noise_Nm=float(np.sqrt(np.mean(noise.torque_Nm**2))),
        encoder_noise_Nm=noise.encoder_Nm,
        current_noise_Nm=noise.current_Nm,
        ripple_percent=ripple.percent,
        ripple_upper_percent=ripple.upper_percent,
        quantities=(
            *_quantities(result, bound.covariance),
            _quantity("ripple", "%", _mean(form, bound.covariance), ripple.percent),
        ),
        shares=_shares(errors, bound, form),
    )


def _bound(fitted: JointFit, noise: WhiteNoise) -> Bound:
    identifiable, prior = fitted.identifiable.opened(), fitted.prior
    torque, law = fitted.torque_information, fitted.law_information
    white = np.maximum((noise.torque_Nm / fitted.noise_Nm) ** 2, LEAST)
    information = _sum(1 / white, torque) + law / noise.law_share
    scores = _sum(white, torque) + law * noise.law_share
    left = torque.sum(axis=0) + law + prior
    by_theta = derivative(left, fitted.solution, identifiable)
    best = by_theta @ inverse_on_seen(information + prior, identifiable)
    used = by_theta @ inverse_on_seen(left, identifiable)
    return Bound(
        white=best @ information @ best.T,
        prior=best @ prior @ best.T,
        weighted=used @ scores @ used.T,
    )


def _sum(factors: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """Return the sum of matrices (n, p, p) times factors (n,), symmetric: instruments are not."""
    total = np.tensordot(factors, matrices, 1)
    return np.asarray((total + total.T) / 2)


def _of_findings(
    result: CalibrationResult,
    fitted: JointFit,
    left: LackOfFit,
    agreement: Kirchhoff | None,
    form: np.ndarray,
) -> np.ndarray:
    """Return what findings add to the covariance (p + 1, p + 1), see `lack_of_fit.widened`."""
    added = (result.dispersion**2 - 1) * fitted.errors.covariance
    for cause in left.causes:
        shifts = cause.shifts @ fitted.derivative.T
        largest = shifts[np.argmax(np.einsum("ni,ij,nj->n", shifts, form, shifts))]
        added = added + np.outer(largest, largest)
    if agreement is not None and not agreement.agrees:
        added[ALPHA, ALPHA] += np.diag(agreement.differences**2)
    return np.asarray(added)


def _quantities(result: CalibrationResult, bound: np.ndarray) -> Iterator[BoundedQuantity]:
    """Yield alpha, beta, delta epsilon, and the orders of the cogging torque in succession."""
    variance = np.diag(bound)
    for phase, name in enumerate("abc"):
        yield _quantity(f"alpha {name}", "", variance[ALPHA][phase], result.alpha_stderr[phase])
    for phase, name in enumerate("abc"):
        yield _quantity(f"beta {name}", "A", variance[BETA][phase], result.beta_stderr_A[phase])
    if result.delta_epsilon_stderr is not None:
        yield _quantity("delta epsilon", "", variance[-1], result.delta_epsilon_stderr)
    rows = []
    for n, harmonic in enumerate(result.harmonics):
        place = slice(FIRST_COGGING + 2 * n, FIRST_COGGING + 2 * n + 2)
        along = np.array([np.sin(harmonic.phase_rad), np.cos(harmonic.phase_rad)])
        of_order = float(along @ bound[place, place] @ along)
        rows.append((harmonic.order, of_order, harmonic.stderr_Nm or 0.0))
    for order, of_order, stderr_Nm in sorted(rows):
        yield _quantity(f"cogging order {order}", "Nm", of_order, stderr_Nm)


def _quantity(name: str, unit: str, bound: float, stderr: float) -> BoundedQuantity:
    efficiency = max(float(bound), 0.0) / max(stderr**2, 1e-300)
    root = float(np.sqrt(max(float(bound), 0.0)))
    return BoundedQuantity(quantity=name, unit=unit, bound=root, efficiency=efficiency)


def _mean(form: np.ndarray, covariance: np.ndarray) -> float:
    return float((form * covariance).sum())


def _shares(
    errors: VarianceComponents, bound: Bound, form: np.ndarray
) -> tuple[VarianceShare, ...]:
    """Return the shares of the mean of the form; they add up to 1."""
    white, weighted = _mean(form, bound.white), _mean(form, bound.weighted)
    parts = {
        WHITE_NOISE: white,
        WEIGHTS: weighted - white,
        COLOUR: _mean(form, errors.of(scatter.TURNS)) - weighted,
        scatter.POINTS: _mean(form, errors.of(scatter.POINTS)),
        NEARLY_SEEN: _mean(form, errors.of(NEARLY_SEEN)),
        PRIORS: _mean(form, errors.of(scatter.PRIORS)),
        FINDINGS: _mean(form, errors.of(FINDINGS)),
    }
    positive = {source: max(part, 0.0) for source, part in parts.items()}
    whole = max(sum(positive.values()), 1e-300)
    return tuple(VarianceShare(source=s, share=part / whole) for s, part in positive.items())
