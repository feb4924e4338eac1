"""The fit of a calibration, linear around its solution, in lines by order over their noise."""

from dataclasses import dataclass, replace

import numpy as np

from motord.experiments.calibration.estimate.lack_of_fit.analysis import LackOfFit
from motord.experiments.calibration.estimate.least_squares.joint import JointFit
from motord.experiments.calibration.estimate.least_squares.normal_equations import Regression
from motord.experiments.calibration.estimate.turn_spectrum import lines_of


@dataclass(frozen=True)
class Weighted:
    """The linear problem in lines over their noise: points, orders, q parameters.

    residual (points, h); columns (points, h, q): derivatives by the parameters; waves (points, h):
    of a cosine of each order; apart (q, q), pull (q,): information and slope that are not from the
    lines; scatter (h,): square by which points scatter about a common line; groups: of each point,
    the residual (groups, h) of groups of its turns.
    """

    torque_Nm: np.ndarray
    rated_A: float
    residual: np.ndarray
    columns: np.ndarray
    waves: np.ndarray
    apart: np.ndarray
    pull: np.ndarray
    scatter: np.ndarray
    groups: tuple[np.ndarray, ...]
    turns: int

    @classmethod
    def of(
        cls, regression: Regression, fitted: JointFit, fit: LackOfFit, rated_A: float
    ) -> "Weighted":
        """Return the problem around a fit. Where points scatter more than noise, that is noise."""
        points, counts = regression.points, regression.basis.back_emf.shape[0]
        theta, highest = fitted.solution.theta, fit.residual_Nm.shape[1]
        derivative = regression.derivative(theta)
        lines = []
        for point in points:
            visits, sums = point.spectrum.visits.sum(axis=0), point.spectrum.sums.sum(axis=0)
            lines.append(lines_of(visits, sums[:, :-1] @ derivative)[:highest])
        waves = np.array([point.spectrum.waves(counts)[:highest] for point in points])
        residual_Nm = fit.residual_Nm - fit.caused_Nm
        scatter = _scatter(residual_Nm / fit.noise_Nm, waves / fit.noise_Nm)
        noise_Nm = fit.noise_Nm * np.sqrt(np.maximum(scatter, 1.0))
        apart_from_torque = fitted.law_information + fitted.prior
        return cls(
            torque_Nm=fit.torque_Nm,
            rated_A=rated_A,
            residual=residual_Nm / noise_Nm,
            columns=np.array(lines) / noise_Nm[:, :, None],
            waves=waves / noise_Nm,
            apart=apart_from_torque,
            pull=-apart_from_torque @ theta,
            scatter=scatter,
            groups=tuple(
                lines / noise for lines, noise in zip(fit.groups_Nm, noise_Nm, strict=True)
            ),
            turns=sum(point.samples.size for point in points),
        )

    def pair(self, order: int) -> np.ndarray:
        """Return the lines of cosine and sine of an order, at that order (points, 2)."""
        wave = self.waves[:, order - 1]
        return np.column_stack([wave, -1j * wave])

    def with_order(self, order: int) -> "Weighted":
        """Return the problem with the amplitudes of an order among its parameters."""
        new = np.zeros((*self.residual.shape, 2), complex)
        new[:, order - 1] = self.pair(order)
        return replace(
            self,
            columns=np.concatenate([self.columns, new], axis=2),
            apart=np.pad(self.apart, (0, 2)),
            pull=np.pad(self.pull, (0, 2)),
        )


def _scatter(residual: np.ndarray, waves: np.ndarray) -> np.ndarray:
    """Return the mean square by which points scatter about a common line (h,).

    residual, waves (points, h) in parts of the noise, which is 1/2 each in real and imaginary part.
    """
    power = (np.abs(waves) ** 2).sum(axis=0)
    common = (waves.conj() * residual).sum(axis=0) / np.maximum(power, 1e-300)
    square = (np.abs(residual - common * waves) ** 2).sum(axis=0)
    return np.asarray(square / max(len(residual) - 1, 1))
