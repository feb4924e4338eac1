"""The turns of all operating points as the sums that the joint estimator solves."""

from dataclasses import dataclass, replace

import numpy as np

from motord.identify.basis import ALPHA, BETA, FIRST_COGGING, Basis
from motord.identify.moments import PointMoments

_COMMANDS_AND_ONE = [4, 5, 6, 3]


@dataclass(frozen=True)
class Turns:
    """All turns, b of them, with p parameters; sums over the samples of each turn.

    x are the regressors of the torque y, z the instruments (as many): xx (b, p, p), xy (b, p),
    yy (b,), zx, zz (b, p, p), zy (b, p). law_xx (b, p, p), law_zx (b, 4, p), law_zz (b, 4, 4): the
    same for Kirchhoff's law, zeros for independent phases. samples (b,); point (b,): its index.
    """

    xx: np.ndarray
    xy: np.ndarray
    yy: np.ndarray
    zx: np.ndarray
    zz: np.ndarray
    zy: np.ndarray
    law_xx: np.ndarray
    law_zx: np.ndarray
    law_zz: np.ndarray
    samples: np.ndarray
    point: np.ndarray

    @classmethod
    def of(cls, points: list[PointMoments], basis: Basis, star: bool) -> "Turns":
        """Gather the turns of all points."""
        m = np.concatenate([point.torque for point in points])
        n = basis.parameters
        x, y = slice(0, n), basis.torque
        z = np.r_[basis.instruments, BETA, FIRST_COGGING:n]
        currents = np.concatenate([point.currents for point in points]) * star
        place = np.zeros((4, n))
        place[:3, ALPHA] = np.eye(3)
        place[3, BETA] = 1
        return cls(
            xx=m[:, x, x],
            xy=m[:, x, y],
            yy=m[:, y, y],
            zx=m[:, z, x],
            zz=m[:, z[:, None], z],
            zy=m[:, z, y],
            law_xx=place.T @ currents[:, :4, :4] @ place,
            law_zx=currents[:, _COMMANDS_AND_ONE, :4] @ place,
            law_zz=currents[:, np.array(_COMMANDS_AND_ONE)[:, None], _COMMANDS_AND_ONE],
            samples=np.concatenate([point.samples for point in points]),
            point=np.repeat(np.arange(len(points)), [point.samples.size for point in points]),
        )

    def keep(self, basis: Basis) -> "Turns":
        """Return the turns with the parameters of `basis` alone, whose orders are the first."""
        n = basis.parameters
        return replace(
            self,
            xx=self.xx[:, :n, :n],
            xy=self.xy[:, :n],
            zx=self.zx[:, :n, :n],
            zz=self.zz[:, :n, :n],
            zy=self.zy[:, :n],
            law_xx=self.law_xx[:, :n, :n],
            law_zx=self.law_zx[:, :, :n],
        )

    def mean_by_point(self, sums: np.ndarray) -> np.ndarray:
        """Return, for each turn, the mean over its operating point's samples (b,)."""
        mean = np.bincount(self.point, sums) / np.bincount(self.point, self.samples)
        floor = 1e-12 * self.yy.sum() / self.samples.sum() + 1e-30
        by_turn: np.ndarray = np.maximum(mean, floor)[self.point]
        return by_turn

    def unexplained(self, theta: np.ndarray) -> np.ndarray:
        """Return the sum of squares of each turn's torque that parameters `theta` leave (b,)."""
        squares = np.einsum("i,bij,j->b", theta, self.xx, theta)
        left: np.ndarray = self.yy - 2 * self.xy @ theta + squares
        return left

    def law_weight(self, theta: np.ndarray) -> float:
        """Return 1 / mean square that Kirchhoff's law leaves; 0 for independent phases."""
        squares = float(theta @ self.law_xx.sum(axis=0) @ theta)
        return float(self.samples.sum()) / squares if squares > 0 else 0.0

    def normals(self, weight: np.ndarray, law_weight: float) -> "Normals":
        """Return the normal equations of each turn by two-stage least squares.

        weight (b,) of each turn's torque samples. The first stage, regressors on instruments, is
        fitted over all turns and kept, so that a turn can be left out of the second.
        """
        first = _first_stage(weight, self.zz, self.zx)
        ones = np.full(weight.size, law_weight)
        law_first = _first_stage(ones, self.law_zz, self.law_zx)
        torque = weight[:, None, None] * (first.T @ self.zx)
        law = law_weight * (law_first.T @ self.law_zx)
        return Normals(torque, law, weight[:, None] * (self.zy @ first))


def _first_stage(weight: np.ndarray, zz: np.ndarray, zx: np.ndarray) -> np.ndarray:
    """Return the coefficients (q, p) of the regressors on the instruments."""
    instruments = np.einsum("b,bij->ij", weight, zz)
    scale = 1 / np.sqrt(np.maximum(np.diag(instruments), 1e-300))
    inverse = np.linalg.pinv(instruments * np.outer(scale, scale), rcond=1e-9, hermitian=True)
    products = np.einsum("b,bij->ij", weight, zx)
    first: np.ndarray = (scale[:, None] * inverse * scale) @ products
    return first


@dataclass(frozen=True)
class Normals:
    """Normal equations of each turn: torque, law (b, p, p) on the left, right (b, p)."""

    torque: np.ndarray
    law: np.ndarray
    right: np.ndarray

    @property
    def torque_information(self) -> np.ndarray:
        """Fisher information that the torque gives (p, p)."""
        return _symmetric(self.torque.sum(axis=0))

    @property
    def information(self) -> np.ndarray:
        """Fisher information of torque and Kirchhoff's law (p, p)."""
        information: np.ndarray = self.torque_information + _symmetric(self.law.sum(axis=0))
        return information


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    half: np.ndarray = (matrix + matrix.T) / 2
    return half
