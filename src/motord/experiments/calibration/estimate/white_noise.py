"""White noise of the measured torque and of the currents: what no estimator avoids.

Not the residual of the model: that has drift, ripple that no column explains, a mount that rings;
and the inverse of the mount, a low-pass, has taken out most of what is white. Groups of turns in
rotation differ by noise alone: what repeats cancels. At the high end of the spectrum, a quarter of
the orders, drift and its like are gone, and noise of sigma per sample makes lines of mean square
4 sigma^2 / n in n samples. The median over the orders lets a few be otherwise. There the
response of the mount, of which the torque has been freed, is put back.

What rounding of the encoder and noise of the currents make of the model's columns is white as well,
and in it. How much that is: delta T' / sqrt(12) for rounding to delta, with T' the change of the
model's torque with the angle at given currents; theta' (X'X - X'Z (Z'Z)^-1 Z'X) theta of what the
instruments do not explain of the currents. Kirchhoff's law has what the commands of a turn do not
explain of the sum of its currents.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from motord.config import TorqueSensorConfig
from motord.experiments.calibration.estimate.lack_of_fit.analysis import FitResidual
from motord.experiments.calibration.estimate.least_squares.joint import JointFit
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    Regression,
)
from motord.experiments.calibration.estimate.turn_spectrum import TurnSpectrum
from motord.identification.torque_sensor import response

HIGH_END = 4
"""The high end of the spectrum is one part of so many."""

LEAST = 1e-9
"""White noise in parts of the residual, at least: synthetic data may have none."""


@dataclass(frozen=True)
class WhiteNoise:
    """Standard deviations per sample: torque_Nm (points,), of it encoder_Nm and current_Nm (RMS
    over the points). law_share: part that is noise of the squares that Kirchhoff's law leaves."""

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
