"""The Cramer-Rao bound of a calibration, its efficiency, and what holds it back.

Information of a turn is X'X / sigma^2, with X what the instruments explain of the model's columns
and sigma the white noise of a sample (`WhiteNoise`); Kirchhoff's law and the priors on the age of
the currents and the zero-order hold add theirs:

    cov >= (sum over turns of X'X / sigma^2 + law / sigma_law^2 + prior)^-1

on the subspace of what is seen. The efficiency of a quantity is the bound over the stated variance,
that of the predicted ripple trace(Q bound) / trace(Q cov) (`predicted_ripple`). The stated variance
has been estimated: of few turns, an efficiency may come out above 1.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from motord.calibration import BoundedQuantity, CramerRao, VarianceShare
from motord.calibration.parts import PRIORS, WHITE_NOISE
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
    Regression,
    cogging_place,
)
from motord.experiments.calibration.estimate.predicted_ripple import PredictedRipple, ripple_form
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.calibration.estimate.turn_spectrum import TurnSpectrum
from motord.identification.torque.torque_sensor import response
from motord.identification.variance_components import VarianceComponents

HIGH_END = 4
"""The high end of the spectrum is one part of so many."""

LEAST = 1e-9
"""White noise in parts of the residual, at least: synthetic data may have none."""

COLOUR = "colour of the noise within turns"
WEIGHTS = "weights of the operating points"
FINDINGS = "findings"


@dataclass(frozen=True)
class WhiteNoise:
    """What no estimator avoids. Standard deviations per sample: torque_Nm (points,), of it
    encoder_Nm and current_Nm (RMS over the points). law_share: part that is noise of the squares
    that Kirchhoff's law leaves.

    Not the residual of the model: that has drift, ripple that no column explains, a mount that
    rings; and the inverse of the mount, a low-pass, has taken out most of what is white. Groups of
    turns in rotation differ by noise alone: what repeats cancels. At the high end of the spectrum,
    a quarter of the orders, drift and its like are gone, and noise of sigma per sample makes lines
    of mean square 4 sigma^2 / n in n samples. The median over the orders lets a few be otherwise.
    There the response of the mount, of which the torque has been freed, is put back.

    What rounding of the encoder and noise of the currents make of the model's columns is white as
    well, and in it. How much that is: delta T' / sqrt(12) for rounding to delta, with T' the change
    of the model's torque with the angle at given currents; theta' (X'X - X'Z (Z'Z)^-1 Z'X) theta of
    what the instruments do not explain of the currents. Kirchhoff's law has what the commands of a
    turn do not explain of the sum of its currents.
    """

    torque_Nm: np.ndarray
    encoder_Nm: float
    current_Nm: float
    law_share: float

    @classmethod
    def of(
        cls, residual: FitResidual, fitted: JointFit, sensor: TorqueSensorConfig
    ) -> "WhiteNoise":
        """Return the noise of the points that were fitted."""
        groups = zip(residual.evidence.rows.groups_Nm, residual.regression.points, strict=True)
        floors_Nm = [floor_Nm(lines, point.spectrum, sensor) for lines, point in groups]
        cell_rad = 2 * np.pi / len(residual.regression.basis.back_emf)
        slopes = [np.square(model.change_Nm_per_rad).mean() for model in residual.models]
        return cls(
            torque_Nm=np.array(floors_Nm),
            encoder_Nm=float(cell_rad * np.sqrt(np.mean(slopes) / 12)),
            current_Nm=_current_noise_Nm(residual.regression, fitted),
            law_share=_law_share(residual.regression, fitted.solution.theta),
        )


def floor_Nm(groups_Nm: np.ndarray, spectrum: TurnSpectrum, sensor: TorqueSensorConfig) -> float:
    """Return the white noise per sample; groups_Nm (groups, orders): lines of groups of turns."""
    count, orders = groups_Nm.shape
    squares = (np.abs(groups_Nm - groups_Nm.mean(axis=0)) ** 2).sum(axis=0) / (count - 1)
    passed = response(sensor, np.arange(1, orders + 1) * abs(spectrum.velocity_Hz))
    high = (squares * np.abs(passed) ** 2)[orders - max(orders // HIGH_END, 1) :]
    median_of_gamma = float(gammaincinv(count - 1, 0.5)) / (count - 1)
    per_sample = 4 * np.mean(1 / spectrum.visits[:, 0].real)
    return float(np.sqrt(np.median(high) / median_of_gamma / per_sample))


def _current_noise_Nm(regression: Regression, fitted: JointFit) -> float:
    theta, samples, squares = fitted.solution.theta, 0, 0.0
    coefficients = regression.coefficients(theta)
    own = slice(0, coefficients.size)
    explained = fitted.torque_information @ theta @ theta * fitted.noise_Nm**2
    for point, of_instruments in zip(regression.points, explained, strict=True):
        samples += int(point.samples.sum())
        squares += coefficients @ point.torque[:, own, own].sum(axis=0) @ coefficients
        squares -= float(of_instruments)
    return float(np.sqrt(max(squares / samples, 0.0)))


def _law_share(regression: Regression, theta: np.ndarray) -> float:
    """Return the part that the commands of each turn by itself do not explain of the squares."""
    if not regression.kirchhoff:
        return 1.0
    weights = np.append(theta[ALPHA], theta[BETA].sum())
    products = np.concatenate([point.currents for point in regression.points])
    inverse = np.linalg.pinv(products[:, 3:, 3:], rcond=1e-9, hermitian=True)
    seen = products[:, 3:, :4] @ weights
    squares = float((products[:, :4, :4] @ weights @ weights).sum())
    explained = float(np.einsum("bi,bij,bj->", seen, inverse, seen))
    return max(1 - explained / squares, LEAST)


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
    form = ripple_form(fitted.solution, regression.cogging_orders, motor, torques_Nm)
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
    """Return what findings add to the covariance (p + 1, p + 1), see `joint_result`."""
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
        place = cogging_place(n)
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
