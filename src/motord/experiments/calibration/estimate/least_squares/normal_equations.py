"""Normal equations of the joint estimator, turn by turn: two-stage least squares.

(X'Z (Z'Z)^-1 Z'X) theta = X'Z (Z'Z)^-1 Z'y
"""

from dataclasses import dataclass, replace

import numpy as np

from motord.experiments.calibration.estimate.turn_products import TurnProducts
from motord.identification.basis import BACK_EMF, CURRENT, FIRST_WAVE, RATE, ZOH_CORRECTION, Basis
from motord.identification.cluster_robust_ls import equilibrated

ALPHA = slice(0, 3)
BETA = slice(3, 6)
DELAY = 6
ZOH = 7
FIRST_COGGING = 8
"""Places of the parameters: gains, offsets, age of the currents, zero-order-hold correction,
cogging cos and sin (`cogging_place`)."""

DELAY_SHARE = 0.25
"""Share of the sampling period that the age of the currents is uncertain by (a prior)."""

ZOH_SHARE = 0.25
"""Share of the squared sampling period that the currents' steps may act as (a prior)."""

COMMANDS_AND_ONE = np.array([4, 5, 6, 3])
"""Places of the instruments of Kirchhoff's law in `TurnProducts.currents`."""


def cogging_place(row: int) -> slice:
    """Return the place of cos and sin of the row-th cogging order."""
    return slice(FIRST_COGGING + 2 * row, FIRST_COGGING + 2 * row + 2)


@dataclass(frozen=True)
class TurnSums:
    """Sums of all turns, b of them, with p parameters; sums over the samples of each turn.

    x are the regressors of the torque y, z the instruments (as many): xx (b, p, p), xy (b, p),
    yy (b,), zx, zz (b, p, p), zy (b, p). kirchhoff_xx (b, p, p), kirchhoff_zx (b, 4, p),
    kirchhoff_zz (b, 4, 4): the same for Kirchhoff's law, zeros for independent phases. samples
    (b,); point (b,): its index. delay_unit_s: unit of parameter DELAY.
    """

    xx: np.ndarray
    xy: np.ndarray
    yy: np.ndarray
    zx: np.ndarray
    zz: np.ndarray
    zy: np.ndarray
    kirchhoff_xx: np.ndarray
    kirchhoff_zx: np.ndarray
    kirchhoff_zz: np.ndarray
    samples: np.ndarray
    point: np.ndarray
    delay_unit_s: float

    def mean_by_point(self, sums: np.ndarray) -> np.ndarray:
        """Return, for each turn, the mean over its operating point's samples (b,)."""
        mean = np.bincount(self.point, sums) / np.bincount(self.point, self.samples)
        floor = 1e-12 * self.yy.sum() / self.samples.sum() + 1e-30
        return np.asarray(np.maximum(mean, floor)[self.point])

    def unexplained(self, theta: np.ndarray) -> np.ndarray:
        """Return the sum of squares of each turn's torque that parameters `theta` leave (b,)."""
        squares = (self.xx @ theta) @ theta
        return np.asarray(self.yy - 2 * self.xy @ theta + squares)

    def total(self, weight: np.ndarray) -> "TurnSums":
        """Return the sums of all turns as one, torque samples weighed by weight (b,)."""

        def weighed(sums: np.ndarray) -> np.ndarray:
            return np.tensordot(weight, sums, 1)[None]

        return replace(
            self,
            xx=weighed(self.xx),
            xy=weighed(self.xy),
            yy=weighed(self.yy),
            zx=weighed(self.zx),
            zz=weighed(self.zz),
            zy=weighed(self.zy),
            kirchhoff_xx=self.kirchhoff_xx.sum(axis=0, keepdims=True),
            kirchhoff_zx=self.kirchhoff_zx.sum(axis=0, keepdims=True),
            kirchhoff_zz=self.kirchhoff_zz.sum(axis=0, keepdims=True),
            samples=self.samples.sum(keepdims=True),
            point=self.point[:1],
        )

    def kirchhoff_weight(self, theta: np.ndarray) -> float:
        """Return 1 / mean square that Kirchhoff's law leaves; 0 for independent phases."""
        squares = float(theta @ self.kirchhoff_xx.sum(axis=0) @ theta)
        return float(self.samples.sum()) / squares if squares > 0 else 0.0

    def normals(
        self, weight: np.ndarray, kirchhoff_weight: float, theta: np.ndarray
    ) -> "NormalEquations":
        """Return the normal equations of each turn by two-stage least squares.

        weight (b,) of each turn's torque samples; theta (p,): parameters of the last round. The
        first stage, regressors on instruments, is fitted over all turns and kept, so that a turn
        can be left out of the second.
        """
        first = _first_stage(weight, self.zz, self.zx)
        torque = weight[:, None, None] * (first.T @ self.zx)
        law = np.zeros_like(self.xx)
        if kirchhoff_weight:
            law = _without_pull(kirchhoff_weight * self.law(), theta)
        return NormalEquations(torque, law, weight[:, None] * (self.zy @ first))

    def law(self) -> np.ndarray:
        """Return the squares that Kirchhoff's law leaves in each turn, as a form (b, p, p)."""
        first = _first_stage(np.ones(self.samples.size), self.kirchhoff_zz, self.kirchhoff_zx)
        return np.asarray(first.T @ self.kirchhoff_zx)


def _without_pull(law: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Return the law's squares (b, p, p) without what noise of the currents adds to them.

    Gains and offsets half as large fulfil the law as well. But what currents with noise, or gains
    that change, do not add up to would pull all of them towards zero. So along gains and offsets
    themselves the law has no slope, whichever way a point deviates.
    """
    size, gain = np.zeros(theta.size), np.zeros(theta.size)
    size[ALPHA], size[BETA] = theta[ALPHA], theta[BETA]
    gain[ALPHA] = theta[ALPHA]
    slope = size @ law / max(float(gain @ gain), 1e-300)
    return np.asarray(law - gain[:, None] * slope[:, None, :])


@dataclass(frozen=True)
class Regression:
    """The model over all points; its regressors depend on the gains, by the age of the currents.

    orders: number of cogging orders to use, the first of the basis; kirchhoff: whether the phase
    currents add up to nothing by law.
    """

    points: list[TurnProducts]
    basis: Basis
    orders: int
    kirchhoff: bool

    @property
    def cogging_orders(self) -> tuple[int, ...]:
        """The orders that are fitted, as their parameters follow."""
        return self.basis.orders[: self.orders]

    @property
    def period_s(self) -> float:
        """Sampling period, the mean over the points."""
        return float(np.mean([point.period_s for point in self.points]))

    def sums(self, gains: np.ndarray) -> TurnSums:
        """Return the sums of all turns.

        Currents older than recorded by d miss d sum_p gains_p di_p/dt k_p.
        """
        m = np.concatenate([point.torque for point in self.points])
        unit_s = DELAY_SHARE * self.period_s
        zoh_s2 = ZOH_SHARE * self.period_s**2
        x = self._choose(CURRENT, RATE, unit_s * gains, zoh_s2)
        z = self._choose(self.basis.command, self.basis.command_rate, unit_s * gains, zoh_s2)
        currents = np.concatenate([point.currents for point in self.points]) * self.kirchhoff
        place = columns_of_law(x.shape[1])
        mx = m[:, :-1, :-1] @ x
        return TurnSums(
            xx=x.T @ mx,
            xy=m[:, -1, :-1] @ x,
            yy=m[:, -1, -1],
            zx=z.T @ mx,
            zz=z.T @ m[:, :-1, :-1] @ z,
            zy=m[:, -1, :-1] @ z,
            kirchhoff_xx=place.T @ currents[:, :4, :4] @ place,
            kirchhoff_zx=currents[:, COMMANDS_AND_ONE, :4] @ place,
            kirchhoff_zz=currents[:, COMMANDS_AND_ONE[:, None], COMMANDS_AND_ONE],
            samples=np.concatenate([point.samples for point in self.points]),
            point=np.repeat(range(len(self.points)), [p.samples.size for p in self.points]),
            delay_unit_s=unit_s,
        )

    def coefficients(self, theta: np.ndarray) -> np.ndarray:
        """Return what each column of the model counts for, with parameters theta."""
        return np.asarray(self.derivative(theta) @ theta)

    def derivative(self, theta: np.ndarray) -> np.ndarray:
        """Return of each column of the model how it counts by each parameter (columns, p)."""
        delays = DELAY_SHARE * self.period_s * theta[ALPHA]
        matrix = self._choose(CURRENT, RATE, delays, ZOH_SHARE * self.period_s**2)
        return matrix[: self.basis.command.start]

    def residual_lines(self, theta: np.ndarray) -> list[np.ndarray]:
        """Return the lines (groups, orders) that parameters theta (p,) leave at each point."""
        spectra = [point.spectrum for point in self.points]
        highest = min(spectrum.highest for spectrum in spectra)
        coefficients = self.coefficients(theta)
        return [spectrum.residual(coefficients)[:, :highest] for spectrum in spectra]

    def _choose(self, current: slice, rate: slice, delays: np.ndarray, zoh_s2: float) -> np.ndarray:
        """Return the matrix that makes regressors, or instruments, of the columns."""
        waves = 2 * self.orders
        matrix = np.zeros((self.basis.width - 1, FIRST_COGGING + waves))
        matrix[current, ALPHA] = np.eye(3)
        matrix[BACK_EMF, BETA] = np.eye(3)
        matrix[rate, DELAY] = delays
        matrix[ZOH_CORRECTION, ZOH] = zoh_s2
        matrix[FIRST_WAVE : FIRST_WAVE + waves, FIRST_COGGING:] = np.eye(waves)
        return matrix


def columns_of_law(parameters: int) -> np.ndarray:
    """Return the columns (4, parameters) of Kirchhoff's law: alpha_p of i*_p, and beta_p of 1."""
    columns = np.zeros((4, parameters))
    columns[:3, ALPHA] = np.eye(3)
    columns[3, BETA] = 1
    return columns


def _first_stage(weight: np.ndarray, zz: np.ndarray, zx: np.ndarray) -> np.ndarray:
    """Return the coefficients (q, p) of the regressors on the instruments."""
    scaled, scale = equilibrated(np.tensordot(weight, zz, 1))
    inverse = np.linalg.pinv(scaled, rcond=1e-9, hermitian=True)
    products = np.tensordot(weight, zx, 1)
    return np.asarray((scale[:, None] * inverse * scale) @ products)


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations of each turn: torque, law (b, p, p) on the left, right (b, p).

    The priors on the age of the currents and on the zero-order-hold correction, 0 +- 1 in their
    units, count with the torque.
    """

    torque: np.ndarray
    law: np.ndarray
    right: np.ndarray

    @property
    def prior(self) -> np.ndarray:
        """Information that is there before any data (p, p)."""
        return prior_information(self.torque.shape[1])

    @property
    def left(self) -> np.ndarray:
        """Left-hand side over all turns (p, p)."""
        return np.asarray(self.torque.sum(axis=0) + self.law.sum(axis=0) + self.prior)

    @property
    def torque_information(self) -> np.ndarray:
        """Fisher information that the torque gives (p, p)."""
        return _symmetric(self.torque.sum(axis=0) + self.prior)

    @property
    def information(self) -> np.ndarray:
        """Fisher information of torque and Kirchhoff's law (p, p)."""
        return _symmetric(self.left)


def prior_information(parameters: int) -> np.ndarray:
    """Return the information (p, p) of the priors on the age of the currents and the zoh."""
    prior = np.zeros((parameters, parameters))
    prior[DELAY, DELAY] = prior[ZOH, ZOH] = 1.0
    return prior


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return np.asarray((matrix + matrix.T) / 2)
