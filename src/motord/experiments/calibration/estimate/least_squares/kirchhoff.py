"""Kirchhoff's law of a star: the ratios of the gains that currents alone give, and the torque's.

And the law of each operating point as rows of unit variance, as the fit weighs it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motord.config import TorqueSensorConfig
from motord.experiments.calibration.estimate.least_squares.joint import JointFit, fit
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    COMMANDS_AND_ONE,
    Regression,
    columns_of_law,
)
from motord.experiments.calibration.estimate.turn_products import accumulate
from motord.identification import IdentifyError
from motord.identification.basis import Basis
from motord.identification.operating_points import Samples
from motord.identification.zero_sequence import restored
from motord.intervals import t_quantile

FALSE_DISAGREEMENT = 0.002
"""Probability that noise makes torque and Kirchhoff's law count as disagreeing."""

AGREEMENT = 1e-3
"""Difference of alpha by torque and by law up to which the model itself explains it: gains drift
with temperature, and currents are held from tick to tick."""

MOST_ROUNDS = 12
"""Fits in which the zero sequence of the currents must settle, where it was not recorded."""

SETTLED = 1e-4
"""Change of alpha from fit to fit below which it has settled."""


def alpha_of_law(law: np.ndarray) -> np.ndarray:
    """Return alpha (3,), product 1, from sum_p (alpha_p i*_p + beta_p) = 0 alone.

    law: the squares that it leaves, as a form (p, p), `TurnSums.law`. The ratios follow from the
    currents, with no torque sensor: the direction in which the instrumented currents do not vary.
    """
    law = (law + law.T) / 2
    offset = law[ALPHA, BETA.start]
    gains = law[ALPHA, ALPHA] - np.outer(offset, offset) / law[BETA.start, BETA.start]
    direction = np.linalg.eigh(gains)[1][:, 0]
    return np.asarray(direction / np.cbrt(direction.prod()))


@dataclass(frozen=True)
class Kirchhoff:
    """alpha from the torque alone less that of Kirchhoff's law: the worst phase, and by how many
    standard errors, of which noise and the model make up to `limit`. differences: of all phases
    (3,)."""

    differences: np.ndarray
    phase: str
    difference: float
    errors: float
    limit: float

    @property
    def agrees(self) -> bool:
        """Whether noise, or the model's accuracy, explains the difference."""
        return self.errors <= self.limit

    def to_text(self) -> str:
        """Return whether the two agree."""
        size = f"{100 * self.difference:+.2f} % in phase {self.phase}"
        if self.agrees:
            return f"alpha from the torque alone agrees with Kirchhoff's law ({size})"
        return (
            f"alpha from the torque alone disagrees with Kirchhoff's law: {size}, "
            f"{self.errors:.0f} standard errors; a common gain delta epsilon other than 1, a wrong "
            "back-EMF or current sensors that are not linear would do that"
        )


def kirchhoff_agreement(regression: Regression, rated_A: float, fitted: JointFit) -> Kirchhoff:
    """Return whether the torque and Kirchhoff's law give the same alpha.

    Where the torque alone does not show the common gain, it has that of the fit to both, `fitted`.
    """
    torque = fit(regression, rated_A, use_law=False)
    by_gain = torque.gain_shift[ALPHA]
    alpha = torque.solution.alpha + by_gain * (fitted.solution.delta_epsilon - 1)
    difference = alpha - alpha_of_law(regression.sums(torque.solution.alpha).law().sum(axis=0))
    variances = torque.stderr[ALPHA] ** 2, (by_gain * fitted.stderr[-1]) ** 2
    least = np.maximum(np.sqrt(sum(variances)), 1e-9)
    worst = int(np.argmax(np.abs(difference) / least))
    freedoms = torque.errors.freedom[worst], fitted.errors.freedom[-1]
    doubt = sum(v[worst] ** 2 / freedom for v, freedom in zip(variances, freedoms, strict=True))
    freedom = least[worst] ** 4 / max(doubt, 1e-300)
    limit = t_quantile(1 - FALSE_DISAGREEMENT / 6, freedom)  # of three phases
    limit = max(limit, AGREEMENT / float(least[worst]))
    errors = float(abs(difference[worst]) / least[worst])
    return Kirchhoff(difference, "abc"[worst], float(difference[worst]), errors, limit)


def with_zero_sequence(
    fitted: JointFit,
    bare: Sequence[Samples],
    basis: Basis,
    orders: int,
    sensor: TorqueSensorConfig,
    rated_A: float,
) -> tuple[JointFit, Regression]:
    """Return the fit to currents with the zero sequence that it itself implies.

    fitted: to currents without it; bare: the samples of each point; orders: of the basis that are
    fitted. Raises IdentifyError where that does not settle.
    """
    for _ in range(MOST_ROUNDS):
        alpha = fitted.solution.alpha
        points = [accumulate(restored(samples, alpha), basis, sensor) for samples in bare]
        regression = Regression(points, basis, orders, False)
        fitted = fit(regression, rated_A)
        if np.abs(fitted.solution.alpha - alpha).max() < SETTLED:
            return fitted, regression
    gains = ", ".join(f"{gain:.2f}" for gain in fitted.solution.alpha)
    raise IdentifyError(
        "the currents have no zero sequence, and with that which follows from the gains found "
        f"these do not settle (alpha {gains}): check wiring, back-EMF and encoder offset, or "
        "record the currents of all three phases"
    )


@dataclass(frozen=True)
class KirchhoffRows:
    """roots (points, 4, 4): rows for changes of what i*_a, i*_b, i*_c and 1 count for; (0, 4, 4)
    where there is no law. residual (4 points,): of it.

    Gains and offsets half as large fulfil the law as well: it shows of v = (alpha, sum of beta) the
    direction alone. So a change d of v counts less its part along v,
    d - v (alpha' d) / (alpha' alpha); otherwise a departure that makes the law 0 = 0 would explain
    whatever is left of it.
    """

    roots: np.ndarray
    residual: np.ndarray

    def columns(self, parameters: int) -> np.ndarray:
        """Return the rows (4 points, parameters) of the model."""
        return np.asarray((self.roots @ columns_of_law(parameters)).reshape(-1, parameters))

    def rows(self, law: np.ndarray) -> np.ndarray:
        """Return the rows (4 points, terms) of an effect, see `Effect.law` (points, terms, 4)."""
        if not len(self.roots):
            return np.zeros((0, law.shape[1]))
        rows = np.einsum("pij,ptj->pit", self.roots, law)
        return np.asarray(rows.reshape(-1, law.shape[1]))


def kirchhoff_rows(regression: Regression, theta: np.ndarray) -> KirchhoffRows:
    """Return the rows, with the commands as instruments, weighed by the residual of the law."""
    weight = regression.sums(theta[ALPHA]).kirchhoff_weight(theta)
    if not (regression.kirchhoff and weight > 0):
        return KirchhoffRows(np.zeros((0, 4, 4)), np.zeros(0))
    roots = []
    for point in regression.points:
        sums = point.currents.sum(axis=0)
        zx = sums[COMMANDS_AND_ONE, :4]
        zz = sums[COMMANDS_AND_ONE[:, None], COMMANDS_AND_ONE]
        information = weight * zx.T @ np.linalg.pinv(zz, rcond=1e-9, hermitian=True) @ zx
        values, vectors = np.linalg.eigh((information + information.T) / 2)
        roots.append(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)
    whole = np.append(theta[ALPHA], theta[BETA].sum())
    gain = np.append(theta[ALPHA], 0.0)
    direction = np.eye(4) - np.outer(whole, gain) / (gain @ gain)
    return KirchhoffRows(np.array(roots) @ direction, -(np.array(roots) @ whole).ravel())
