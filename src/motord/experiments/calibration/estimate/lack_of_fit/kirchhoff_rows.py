"""Kirchhoff's law of each operating point as rows of unit variance, as the fit weighs it.

Gains and offsets half as large fulfil the law as well: it shows of v = (alpha, sum of beta) the
direction alone. So a change d of v counts less its part along v, d - v (alpha' d) / (alpha' alpha);
otherwise a departure that makes the law 0 = 0 would explain whatever is left of it.
"""

from dataclasses import dataclass

import numpy as np

from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    Regression,
)

_CURRENTS_AND_ONE = slice(0, 4)
_COMMANDS_AND_ONE = np.array([4, 5, 6, 3])


@dataclass(frozen=True)
class KirchhoffRows:
    """roots (points, 4, 4): rows for changes of what i*_a, i*_b, i*_c and 1 count for; (0, 4, 4)
    where there is no law. residual (4 points,): of it."""

    roots: np.ndarray
    residual: np.ndarray

    def columns(self, parameters: int) -> np.ndarray:
        """Return the rows (4 points, parameters) of the model: alpha_p i*_p, and beta_p 1."""
        place = np.zeros((4, parameters))
        place[:3, ALPHA] = np.eye(3)
        place[3, BETA] = 1
        return np.asarray((self.roots @ place).reshape(-1, parameters))

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
        zx = sums[_COMMANDS_AND_ONE, _CURRENTS_AND_ONE]
        zz = sums[_COMMANDS_AND_ONE[:, None], _COMMANDS_AND_ONE]
        information = weight * zx.T @ np.linalg.pinv(zz, rcond=1e-9, hermitian=True) @ zx
        values, vectors = np.linalg.eigh((information + information.T) / 2)
        roots.append(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)
    whole = np.append(theta[ALPHA], theta[BETA].sum())
    gain = np.append(theta[ALPHA], 0.0)
    direction = np.eye(4) - np.outer(whole, gain) / (gain @ gain)
    return KirchhoffRows(np.array(roots) @ direction, -(np.array(roots) @ whole).ravel())
