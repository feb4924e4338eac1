"""Coast-downs to first order around a fit: by how much a change of a coefficient changes the angle.

Columns of the model are integrals over the angle (`coast_down_rows`), which a coefficient changes,
too: a cogging torque that is larger takes the rotor elsewhere, where it is another one. A column u
thus changes the angle by z,

    z = u + K z,    K z = int int (dT/dq z - dF/dw z') dt dt

with T the cogging torque and F the friction by the fit, over the inertia: a Volterra equation. By
z instead of u, least squares is a Gauss-Newton step, and covariances are those of its errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dgbtrf, dgbtrs

from motord.experiments.friction.coast_down_rows import CoastDownRows
from motord.experiments.friction.two_step_fit import OWN, bases, partialled_out

BELOW, ABOVE = 3, 1
"""Diagonals of the band matrix; its unknowns are z' - u' and z of each row in turn."""


@dataclass(frozen=True)
class Linearisation:
    """What a fit is linearised by.

    stiffness, damping (n - 1,): dT/dq and dF/dw, means between rows; at_rows (n,): dT/dq there.
    """

    rows: CoastDownRows
    stiffness: np.ndarray
    at_rows: np.ndarray
    damping: np.ndarray

    @classmethod
    def around(
        cls,
        rows: CoastDownRows,
        orders: Sequence[int],
        q_rad: np.ndarray,
        solution: np.ndarray,
        at_rad_s: float,
    ) -> "Linearisation":
        """Linearise around angles (n,) and what is fitted to them.

        solution (p,): F/J, b/J, C/J and D/J of `orders`, with at_rad_s, which is w_s, S/J too.
        """
        damping = np.full(q_rad.size - 1, solution[1])
        if at_rad_s:
            speed_rad_s = rows.speed_rad_s(q_rad)
            ratio = (speed_rad_s[1:] + speed_rad_s[:-1]) / 2 / at_rad_s
            damping -= solution[-1] * np.exp(-(ratio**2)) * 2 * ratio / at_rad_s
        lines = solution[OWN : OWN + 2 * len(orders)]
        return cls(rows, *rows.stiffness(orders, lines, q_rad), damping)

    def changes(self, columns: np.ndarray) -> np.ndarray:
        """Return z (n, p) of columns (n, p): by how much one of each changes the angle."""
        within = self._within
        right = np.zeros((2 * len(columns), columns.shape[1]), order="F")
        right[1] = columns[0]
        right[3::2] = columns[1:] - within[:, None] * columns[:-1]
        factors, pivots = self._factors
        solution, _ = dgbtrs(factors, BELOW, ABOVE, right, pivots, overwrite_b=True)
        return np.asarray(solution[1::2])

    def projected(self, changes: np.ndarray) -> np.ndarray:
        """Return changes (n,) or (n, p) less what another start of each coast-down explains."""
        return partialled_out(self._nuisance, changes, self.rows.first)

    @cached_property
    def _nuisance(self) -> list[np.ndarray]:
        """Orthonormal columns that span the changes by a + v t, of each."""
        start = np.column_stack([np.ones_like(self.rows.t_s), self.rows.t_s])
        return bases(self.changes(start), self.rows.first)

    @cached_property
    def _within(self) -> np.ndarray:
        """Return 1 where two rows are of one coast-down, else 0 (n - 1,)."""
        within = np.ones(self.rows.t_s.size - 1)
        within[self.rows.first[1:] - 1] = 0.0
        return within

    @cached_property
    def _factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the matrix as a product of triangular ones, and the exchanges of its rows."""
        room = np.zeros((2 * BELOW + ABOVE + 1, 2 * self.rows.t_s.size), order="F")
        room[BELOW:] = np.asarray_chkfinite(self._band)
        factors, pivots, singular = dgbtrf(room, BELOW, ABOVE, overwrite_ab=True)
        if singular:
            raise np.linalg.LinAlgError("singular matrix")
        return factors, pivots

    @cached_property
    def _band(self) -> np.ndarray:
        """Return the matrix by its diagonals (5, 2 n); integrals are those of cubics."""
        within = self._within
        half_s = within * self.rows.steps_s / 2
        pull = half_s * self.stiffness
        damping = within * self.damping - half_s * np.diff(self.at_rows) / 6
        band = np.zeros((BELOW + ABOVE + 1, 2 * self.rows.t_s.size))
        band[1] = 1.0
        of_speed, of_angle = slice(0, -2, 2), slice(1, -2, 2)  # columns of the row before
        band[0, 3::2] = damping - pull
        band[2, of_angle] = -damping - pull
        band[3, of_speed] = -within
        band[2, 2::2] = -half_s
        band[4, of_speed] = -half_s
        cubic = half_s**2 / 3
        band[1, 3::2] += cubic * self.at_rows[1:]
        band[3, of_angle] = -within - cubic * self.at_rows[:-1]
        return band
