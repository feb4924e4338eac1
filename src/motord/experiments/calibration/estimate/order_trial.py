"""The trial of a further cogging order: a score test in the fit, linear around its solution.

Every order h of the turn is tried as one more pair of columns. With what the model leaves, r, at
point p and order k, the new columns' effect D less what the model's own parameters A take of it,
and the noise n as weights, the pair would take

    gain = s' V^-1 s,   s = D' r - B N^-1 A' r,   V = D' D - B N^-1 B',   B = D' A,  N = A' A + L

of the sum of squares (score test; L: Kirchhoff's law and the priors). So an order at an odd
multiple of the pole pairs, where the currents' offsets make torque too, is judged by what these
cannot imitate. Orders enter one after the other, best first, by the criterion of
`OrderTrial.enters`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from motord.calibration import AddedOrder
from motord.experiments.calibration.estimate.lack_of_fit.analysis import LackOfFit
from motord.experiments.calibration.estimate.lack_of_fit.departures import FALSE_SHARE
from motord.experiments.calibration.estimate.lack_of_fit.score_test import cluster_variance
from motord.experiments.calibration.estimate.least_squares.joint import JointFit
from motord.experiments.calibration.estimate.least_squares.normal_equations import BETA, Regression
from motord.experiments.calibration.estimate.turn_spectrum import lines_of, orders_averaged
from motord.identification.cluster_robust_ls import equilibrated
from motord.intervals import f_tail

SEPARABLE = 1e-5
"""Part of an order's effect that the other parameters leave, below which it cannot be tested."""

CLEAR = 0.1
"""Part of its effect from which on an order counts as one that nothing imitates."""

TOLERANCE = 10.0
"""Squares of noise by which one explanation has to be worse than another to be given up."""


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


@dataclass(frozen=True)
class OrderTrial:
    """An order that was tried.

    stderr_Nm: of its amplitude, nan where other parameters imitate it; part_Nm, part_stderr_Nm: the
    amplitude of what they do not imitate of it; clear: whether none comes near to that;
    offset_A_per_Nm: by how much it moves the offsets if it is there and left out; offset_shift_A
    (3,): by how much they would move with it, what they imitate taken as large as what they do not;
    offset_stderr_A: how well these, less
    what all have in common, are known with it; predicts: whether torques predict each other.
    """

    order: int
    gain: float
    p_value: float
    bic: float
    stderr_Nm: float
    part_Nm: float
    part_stderr_Nm: float
    clear: bool
    offset_A_per_Nm: float
    offset_shift_A: np.ndarray
    offset_stderr_A: float
    predicts: bool

    def enters(self, level: float) -> bool:
        """Return whether the order belongs to the model, by chance with a p-value below `level`.

        Besides, it pays for two parameters by BIC with the number of turns, and the line that all
        other torques show predicts the residual at each.
        """
        return self.p_value < level and self.bic > 0 and self.predicts

    def entered(self) -> AddedOrder:
        """Return it as the calibration file has it."""
        return AddedOrder(order=self.order, p_value=self.p_value, bic=self.bic)


def tried(problem: Weighted, orders: Sequence[int]) -> list[OrderTrial]:
    """Return the trial of each of the orders."""
    flat = problem.columns.reshape(-1, problem.columns.shape[2])
    information = 2 * (flat.conj().T @ flat).real + problem.apart
    slope = 2 * (flat.conj().T @ problem.residual.ravel()).real + problem.pull
    inverse = _inverse(information)
    step = inverse @ slope
    places = np.array(orders, int) - 1
    waves, residual = problem.waves.T[places], problem.residual.T[places]
    pairs = np.swapaxes(np.stack([waves, -1j * waves], axis=2).conj(), 1, 2)
    cross = 2 * (pairs @ np.swapaxes(problem.columns, 0, 1)[places]).real
    whole = 2 * (np.abs(waves) ** 2).sum(axis=1)
    score = 2 * (pairs @ residual[:, :, None])[:, :, 0].real - cross @ step
    across = np.swapaxes(cross, 1, 2)
    left = whole[:, None, None] * np.eye(2) - cross @ inverse @ across
    scores = _Scores(orders, score, whole, *np.linalg.eigh(left), inverse @ across)
    return list(_trials(problem, step, scores))


def _inverse(information: np.ndarray) -> np.ndarray:
    scaled, scale = equilibrated(information)
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-14, hermitian=True) * np.outer(scale, scale))


class _Scores(NamedTuple):
    """s (n, 2) and V, by its eigenvalues and eigenvectors, of n orders; whole (n,): on the diagonal
    of D' D; taken (n, q, 2): what the other parameters take of a unit of each of the pair."""

    orders: Sequence[int]
    score: np.ndarray
    whole: np.ndarray
    values: np.ndarray
    vectors: np.ndarray
    taken: np.ndarray


def _trials(problem: Weighted, step: np.ndarray, of: _Scores) -> Iterator[OrderTrial]:
    """Yield the trial of each order, of all at once; parts (n, 2) are along the eigenvectors."""
    whole = of.whole[:, None]
    seen = of.values > SEPARABLE * whole
    stderr_Nm = np.where(seen, of.values, np.nan) ** -0.5
    part = (of.score[:, None] @ of.vectors)[:, 0]
    size = np.where(seen, part / np.where(seen, of.values, 1.0), 0.0)
    gain, part_Nm = (part * size).sum(axis=1), np.linalg.norm(size, axis=1)
    bic = gain - seen.sum(axis=1) * np.log(problem.turns)
    offset_A = of.taken[:, BETA]
    moves_A = offset_A @ of.vectors
    hidden_A = part_Nm[:, None] * np.linalg.norm(moves_A * ~seen[:, None], axis=2)
    apart_A = np.linalg.norm(moves_A - moves_A.mean(axis=1, keepdims=True), axis=1)
    chances = [(1.0, False)] * len(of.orders)
    for n in np.flatnonzero(bic > 0).tolist():  # few orders
        effect = _effect(problem, of.orders[n], of.taken[n]) @ of.vectors[n][:, seen[n]]
        p_value = _chance(problem, effect, size[n][seen[n]], float(gain[n]))
        residual = problem.residual - problem.columns @ step
        chances[n] = p_value, p_value < FALSE_SHARE and _predicts(problem, effect, residual)
    yield from map(
        OrderTrial,
        of.orders,
        gain.tolist(),
        (p_value for p_value, _ in chances),
        bic.tolist(),
        stderr_Nm[:, 0].tolist(),
        part_Nm.tolist(),
        np.fmax(*stderr_Nm.T).tolist(),
        (of.values[:, 0] > CLEAR * of.whole).tolist(),
        np.abs(offset_A).max(axis=(1, 2)).tolist(),
        np.hypot((moves_A @ size[:, :, None])[:, :, 0], hidden_A),
        (apart_A / np.sqrt(np.maximum(of.values, 1e-12 * whole))).max(axis=1).tolist(),
        (predicts for _, predicts in chances),
    )


def _effect(problem: Weighted, order: int, others: np.ndarray) -> np.ndarray:
    """Return what an order's pair does (points, h, 2) less what `others` (p, 2) take of it."""
    effect = -problem.columns @ others
    effect[:, order - 1] += problem.pair(order)
    return np.asarray(effect)


def _chance(problem: Weighted, effect: np.ndarray, size: np.ndarray, gain: float) -> float:
    """Return the probability of a gain by chance: by noise, by the scatter over points or turns.

    effect (points, h, terms): what nothing else in the model takes of it; size (terms,): how much
    of it. The first two errors are estimated at the orders at which it is, with degrees of freedom
    by Welch and Satterthwaite. The last is cluster-robust by groups of turns: noise that a turn has
    at many orders alike, as where samples are missing, looks like an order that offsets imitate.
    """
    points, orders, terms = effect.shape
    share = (np.abs(effect) ** 2).sum(axis=(0, 2))
    share /= share.sum()
    noise_freedom = points / (share**2 / (2 * orders_averaged(orders))).sum()
    by_noise = f_tail(gain / terms, terms, noise_freedom)
    scatter = float(share @ (problem.scatter / np.maximum(problem.scatter, 1.0)))
    freedom = 2 * max(points - 1, 1) / (share**2).sum()
    by_scatter = f_tail(gain / terms / max(scatter, 1e-300), terms, freedom)
    along = effect.conj() @ size
    white = (np.abs(along) ** 2).sum(axis=1)
    variance, freedom = cluster_variance(problem.groups, 2 * along, white)
    by_turns = f_tail(gain**2 / variance / terms, terms, freedom) if variance else 0.0
    return float(max(by_noise, by_scatter, by_turns))


def _predicts(problem: Weighted, effect: np.ndarray, residual: np.ndarray) -> bool:
    """Return whether an order is the same at all torques.

    What other torques show of it lessens the residual at each torque, and an amplitude that grows
    with the torque, or with its square, does not explain more of it; both but for noise.
    """
    torques_Nm = np.unique(problem.torque_Nm)
    if torques_Nm.size < 2:
        return False
    growing = max(_growing(problem, effect, residual, power) for power in (1, 2))
    if growing > _explained(effect, residual) + TOLERANCE:
        return False
    for torque_Nm in torques_Nm:
        out = problem.torque_Nm == torque_Nm
        others = effect[~out].reshape(-1, effect.shape[2])
        normal = (others.conj().T @ others).real
        right = (others.conj().T @ residual[~out].ravel()).real
        size = np.linalg.lstsq(normal, right, rcond=None)[0]
        after = residual[out] - effect[out] @ size
        if (np.abs(after) ** 2).sum() > (np.abs(residual[out]) ** 2).sum() + TOLERANCE:
            return False
    return True


def _growing(problem: Weighted, effect: np.ndarray, residual: np.ndarray, power: int) -> float:
    """Return how much of the residual an effect explains that grows with a power of the torque."""
    return _explained(effect * (problem.torque_Nm**power)[:, None, None], residual)


def _explained(effect: np.ndarray, residual: np.ndarray) -> float:
    flat = effect.reshape(-1, effect.shape[2])
    right = (flat.conj().T @ residual.ravel()).real
    return float(right @ np.linalg.lstsq((flat.conj().T @ flat).real, right, rcond=None)[0])
