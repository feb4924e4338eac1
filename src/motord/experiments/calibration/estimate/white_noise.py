"""White noise of the measured torque and of the currents: what no estimator avoids.

Not what the model leaves: that holds drift, ripple that no column explains, and a mount that rings;
and the inverse of the mount, a low-pass, has taken out most of what is white. Groups of turns in
rotation differ by noise alone: what repeats cancels. At the high end of the spectrum, a quarter of
the orders, drift and its like are gone, and noise of sigma per sample makes lines of mean square
4 sigma^2 / n in n samples. The median over the orders lets a few be otherwise. There the
response of the mount, of which the torque has been freed, is put back.

What rounding of the encoder and noise of the currents make of the model's columns is white as well,
and in it. How much that is: delta T' / sqrt(12) for rounding to delta, with T' the change of the
model's torque with the angle at given currents; theta' (X'X - X'Z (Z'Z)^-1 Z'X) theta of what the
instruments do not explain of the currents.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from motord.config import TorqueSensorConfig
from motord.experiments.calibration.estimate.lack_of_fit.analysis import FitResidual
from motord.experiments.calibration.estimate.normal_equations import TurnSums
from motord.experiments.calibration.estimate.turn_spectrum import TurnSpectrum
from motord.identification.torque_sensor import response

HIGH_END = 4
"""The high end of the spectrum is one part of so many."""

LEAST = 1e-9
"""White noise in parts of what the model leaves, at least: made-up data may have none."""


@dataclass(frozen=True)
class WhiteNoise:
    """Standard deviations per sample: torque_Nm (points,), of it encoder_Nm and current_Nm (RMS
    over the points); law_A: of the sum of the currents that Kirchhoff's law is for, 0 for none."""

    torque_Nm: np.ndarray
    encoder_Nm: float
    current_Nm: float
    law_A: float

    @classmethod
    def of(
        cls, residual: FitResidual, turns: TurnSums, theta: np.ndarray, sensor: TorqueSensorConfig
    ) -> "WhiteNoise":
        """Return the noise; turns: sums with the gains of parameters theta (p,)."""
        groups = zip(residual.evidence.rows.groups_Nm, residual.regression.points, strict=True)
        floors_Nm = [floor_Nm(lines, point.spectrum, sensor) for lines, point in groups]
        cell_rad = 2 * np.pi / len(residual.regression.basis.back_emf)
        slopes = [np.mean(model.change_Nm_per_rad**2) for model in residual.models]
        return cls(
            torque_Nm=np.array(floors_Nm),
            encoder_Nm=float(cell_rad * np.sqrt(np.mean(slopes) / 12)),
            current_Nm=_current_noise_Nm(turns, theta),
            law_A=_law_noise_A(turns, theta),
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


def _current_noise_Nm(turns: TurnSums, theta: np.ndarray) -> float:
    ones = np.ones(turns.samples.size)
    explained = turns.normals(ones, 0.0, theta).torque.sum(axis=0)
    squares = theta @ (turns.xx.sum(axis=0) - explained) @ theta
    return float(np.sqrt(max(squares / turns.samples.sum(), 0.0)))


def _law_noise_A(turns: TurnSums, theta: np.ndarray) -> float:
    """Return what the commands of each turn by itself do not explain of the sum of currents."""
    inverse = np.linalg.pinv(turns.kirchhoff_zz, rcond=1e-9, hermitian=True)
    seen = turns.kirchhoff_zx @ theta
    squares = np.einsum("i,bij,j->b", theta, turns.kirchhoff_xx, theta)
    squares -= np.einsum("bi,bij,bj->b", seen, inverse, seen)
    return float(np.sqrt(max(squares.sum() / turns.samples.sum(), 0.0)))
