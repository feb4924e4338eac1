"""Cogging orders beyond those that slots and poles allow, where the data show them.

Every order h of the turn is tried as one more pair of columns. With what the model leaves, r, at
point p and order k, the new columns' effect D less what the model's own parameters A take of it,
and the noise n as weights, the pair would take

    gain = s' V^-1 s,   s = D' r - B N^-1 A' r,   V = D' D - B N^-1 B',   B = D' A,  N = A' A + L

of the sum of squares (score test; L: Kirchhoff's law and the priors). So an order at an odd
multiple of the pole pairs, where the currents' offsets make torque too, is judged by what these
cannot imitate. Orders enter one after the other, best first, by the criterion of `_enters`.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from motord.calibration import AddedOrder, Harmonic
from motord.experiments.calibration.estimate.joint import JointFit
from motord.experiments.calibration.estimate.lack_of_fit import NOISE_FREEDOM, LackOfFit
from motord.experiments.calibration.estimate.normal_equations import BETA, Regression
from motord.experiments.calibration.estimate.turn_spectrum import lines_of
from motord.findings import Finding

FALSE_SHARE = 0.002
"""Probability that noise makes any order enter, over all that are tried."""

SEPARABLE = 1e-5
"""Part of an order's effect that the other parameters leave, below which it cannot be tested."""

CLEAR = 0.1
"""Part of its effect from which on an order counts as one that nothing imitates."""

TOLERANCE = 10.0
"""Squares of noise by which one explanation has to be worse than another to be given up."""

FIRST_ORDER = 2
"""Lowest order that is tried: mean and slope of each turn, which drift makes, are most of order 1.
"""

CONFIRMED = 3.0
"""Standard errors that the amplitude of an order that entered has in the fit at least."""

OFFSET_SHARE = 0.01
"""Part of the rated current that the offsets have to be known to with an order for it to enter."""

MEASURE_APART = (
    "measure the offsets at rest, or the cogging torque without currents (`motord plan start "
    "cogging`)"
)

MAX_ADDED = 12
"""Orders that enter at most: each costs time and memory."""


@dataclass(frozen=True)
class OrderTrial:
    """An order that was tried.

    stderr_Nm: of its amplitude, nan where other parameters imitate it; clear: whether none comes
    near to that; offset_A_per_Nm: by how much it moves the offsets if it is there and left out;
    offset_stderr_A: how well these, less what all have in common, are known with it; predicts:
    whether torques predict each other.
    """

    order: int
    gain: float
    p_value: float
    bic: float
    stderr_Nm: float
    clear: bool
    offset_A_per_Nm: float
    offset_stderr_A: float
    predicts: bool

    def enters(self, tried: int) -> bool:
        """Return whether the order belongs to the model: `tried` orders were.

        Its gain is more than chance makes of so many, pays for two parameters by BIC with the
        number of turns, and the line that all other torques show predicts what is left at each.
        """
        return self.p_value < FALSE_SHARE / tried and self.bic > 0 and self.predicts

    def entered(self) -> AddedOrder:
        """Return it as the calibration file has it."""
        return AddedOrder(order=self.order, p_value=self.p_value, bic=self.bic)


@dataclass(frozen=True)
class Weighted:
    """The linear problem in lines over their noise: points, orders, q parameters.

    rest (points, h); columns (points, h, q): derivatives by the parameters; waves (points, h): of
    a cosine of each order; apart (q, q), pull (q,): information and slope that are not from the
    lines; scatter (h,): square by which points scatter about a common line.
    """

    torque_Nm: np.ndarray
    rated_A: float
    rest: np.ndarray
    columns: np.ndarray
    waves: np.ndarray
    apart: np.ndarray
    pull: np.ndarray
    scatter: np.ndarray
    turns: int

    @classmethod
    def of(
        cls, regression: Regression, fitted: JointFit, fit: LackOfFit, rated_A: float
    ) -> "Weighted":
        """Return the problem around a fit. Where points scatter more than noise, that is noise."""
        points, counts = regression.points, regression.basis.back_emf.shape[0]
        theta, highest = fitted.solution.theta, fit.left_Nm.shape[1]
        derivative = regression.derivative(theta)
        lines = []
        for point in points:
            visits, sums = point.spectrum.visits.sum(axis=0), point.spectrum.sums.sum(axis=0)
            lines.append(lines_of(visits, sums[:, :-1] @ derivative)[:highest])
        waves = np.array([point.spectrum.waves(counts)[:highest] for point in points])
        scatter = _scatter(fit.left_Nm / fit.noise_Nm, waves / fit.noise_Nm)
        noise_Nm = fit.noise_Nm * np.sqrt(np.maximum(scatter, 1.0))
        return cls(
            torque_Nm=fit.torque_Nm,
            rated_A=rated_A,
            rest=fit.left_Nm / noise_Nm,
            columns=np.array(lines) / noise_Nm[:, :, None],
            waves=waves / noise_Nm,
            apart=fitted.apart_from_torque,
            pull=-fitted.apart_from_torque @ theta,
            scatter=scatter,
            turns=sum(point.samples.size for point in points),
        )

    def pair(self, order: int) -> np.ndarray:
        """Return the lines of cosine and sine of an order, at that order (points, 2)."""
        wave = self.waves[:, order - 1]
        return np.column_stack([wave, -1j * wave])

    def with_order(self, order: int) -> "Weighted":
        """Return the problem with the amplitudes of an order among its parameters."""
        new = np.zeros((*self.rest.shape, 2), complex)
        new[:, order - 1] = self.pair(order)
        return replace(
            self,
            columns=np.concatenate([self.columns, new], axis=2),
            apart=np.pad(self.apart, (0, 2)),
            pull=np.pad(self.pull, (0, 2)),
        )


def _scatter(rest: np.ndarray, waves: np.ndarray) -> np.ndarray:
    """Return the mean square by which points scatter about a common line (h,).

    rest, waves (points, h) in parts of the noise, which is 1/2 each in real and imaginary part.
    """
    power = (np.abs(waves) ** 2).sum(axis=0)
    common = (waves.conj() * rest).sum(axis=0) / np.maximum(power, 1e-300)
    square = (np.abs(rest - common * waves) ** 2).sum(axis=0)
    return np.asarray(square / max(len(rest) - 1, 1))


@dataclass(frozen=True)
class Search:
    """Orders that entered, of how many that were tried, over how many turns.

    imitated: those that did not, and that the currents' offsets can imitate. instead: pairs of an
    order that entered and one that would explain as much in its place. inseparable: orders that
    the data show, and with which the currents' offsets would not be known.
    """

    added: tuple[OrderTrial, ...]
    imitated: tuple[OrderTrial, ...]
    instead: tuple[tuple[int, int], ...]
    inseparable: tuple[int, ...]
    tried: int
    turns: int

    def without(self, orders: Sequence[int]) -> "Search":
        """Return the search with these orders out again."""
        return replace(
            self,
            added=tuple(one for one in self.added if one.order not in orders),
            instead=tuple(pair for pair in self.instead if pair[0] not in orders),
        )

    def findings(self, harmonics: Sequence[Harmonic]) -> Iterator[Finding]:
        """Yield a finding for each order that the data cannot tell from others or from offsets."""
        for order in self.inseparable:
            yield Finding(
                name=f"offsets-or-cogging-order-{order}",
                value=float(order),
                limit=0.0,
                unit="per turn",
                severity="serious",
                meaning=f"cogging torque of order {order} is there, but these points do not tell "
                "it from offsets of the currents: it was taken for these, which are wrong",
                action=MEASURE_APART,
            )
        for order, other in self.instead:
            [h] = [h for h in harmonics if h.order == order]
            yield Finding(
                name=f"cogging-order-{order}-or-{other}",
                value=1e3 * h.amplitude_Nm,
                limit=1e3 * CONFIRMED * h.stderr_Nm,
                unit="mNm",
                severity="serious",
                meaning=f"cogging torque of order {order}, with other offsets of the currents, and "
                f"of order {other} explain the torque alike: the offsets' intervals hold for "
                f"order {order}",
                action=MEASURE_APART,
            )

    def in_words(self) -> Iterator[str]:
        """Yield which orders were added and why, and which could not be told from offsets."""
        if self.added:
            names = in_a_row(trial.order for trial in self.added)
            yield (
                f"cogging {names} added, which slots and poles do not allow: there at all torques "
                f"alike, less than {100 * FALSE_SHARE:g} % by chance over the {self.tried} orders "
                f"tried, and worth it by BIC with {self.turns} turns"
            )
        surely = float(np.sqrt(stats.chi2.isf(FALSE_SHARE / max(self.tried, 1), 2)))
        for trial in self.imitated:
            if np.isnan(trial.stderr_Nm):
                yield (
                    f"cogging order {trial.order} and the currents' offsets cannot be told apart: "
                    "taken as offsets"
                )
            else:
                most_Nm = surely * trial.stderr_Nm
                yield (
                    f"cogging order {trial.order}: taken as none; less than "
                    f"{1e3 * most_Nm:.2g} mNm would not be noticed, and moves the currents' "
                    f"offsets by up to {most_Nm * trial.offset_A_per_Nm:.2g} A"
                )


def search(problem: Weighted, known: Sequence[int], pole_pairs: int) -> Search:
    """Return the orders that enter beside those that are `known`, by forward selection."""
    added: list[OrderTrial] = []
    rivals: list[tuple[int, int]] = []
    candidates = [o for o in range(FIRST_ORDER, problem.rest.shape[1] + 1) if o not in known]
    count, most_A = len(candidates), OFFSET_SHARE * problem.rated_A
    while True:
        trials = tried(problem, candidates)
        shown = [trial for trial in trials if trial.enters(count)]
        good = [trial for trial in shown if trial.offset_stderr_A < most_A]
        if not good or len(added) == MAX_ADDED:
            break
        most = max(trial.gain for trial in good) - TOLERANCE
        near = [trial for trial in good if trial.gain >= most]
        # of several that explain as much, one that offsets imitate: it is seen at many orders
        best = min(near, key=lambda trial: (trial.clear, -trial.gain))
        added.append(best)
        rivals += [(best.order, trial.order) for trial in near if trial is not best]
        problem = problem.with_order(best.order)
        candidates.remove(best.order)
    rivals += [(trial.order, 0) for trial in shown if trial not in good]
    imitated = tuple(
        trial
        for trial in trials
        if trial.order % (2 * pole_pairs) == pole_pairs and not trial.clear
    )
    orders = {trial.order for trial in added}
    instead = tuple(pair for pair in rivals if pair[1] not in orders and 0 not in pair)
    inseparable = {pair[0] for pair in rivals if not pair[1]} - {pair[1] for pair in instead}
    return Search(tuple(added), imitated, instead, tuple(sorted(inseparable)), count, problem.turns)


def tried(problem: Weighted, orders: Sequence[int]) -> list[OrderTrial]:
    """Return the trial of each of the orders."""
    flat = problem.columns.reshape(-1, problem.columns.shape[2])
    information = 2 * (flat.conj().T @ flat).real + problem.apart
    slope = 2 * (flat.conj().T @ problem.rest.ravel()).real + problem.pull
    inverse = _inverse(information)
    return [_trial(problem, order, inverse, inverse @ slope) for order in orders]


def _inverse(information: np.ndarray) -> np.ndarray:
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information * np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-14, hermitian=True) * np.outer(scale, scale))


def _trial(problem: Weighted, order: int, inverse: np.ndarray, step: np.ndarray) -> OrderTrial:
    place, pair = order - 1, problem.pair(order)
    cross = 2 * (pair.conj().T @ problem.columns[:, place]).real
    whole = 2 * float((np.abs(pair[:, 0]) ** 2).sum())
    score = 2 * (pair.conj().T @ problem.rest[:, place]).real - cross @ step
    values, vectors = np.linalg.eigh(whole * np.eye(2) - cross @ inverse @ cross.T)
    moves_A = (inverse @ cross.T)[BETA]
    offset_A = float(np.abs(moves_A).max())
    apart_A = np.linalg.norm((moves_A - moves_A.mean(axis=0)) @ vectors, axis=0)
    offset_stderr_A = float((apart_A / np.sqrt(np.maximum(values, 1e-12 * whole))).max())
    seen = values > SEPARABLE * whole
    if not seen.any():
        return OrderTrial(
            order, 0.0, 1.0, 0.0, float("nan"), False, offset_A, offset_stderr_A, False
        )
    part, terms = vectors[:, seen], int(seen.sum())
    gain = float(((part.T @ score) ** 2 / values[seen]).sum())
    bic = gain - terms * float(np.log(problem.turns))
    p_value = _chance(problem, place, gain, terms) if bic > 0 else 1.0
    return OrderTrial(
        order=order,
        gain=gain,
        p_value=p_value,
        bic=bic,
        stderr_Nm=float(values[0] ** -0.5) if seen.all() else float("nan"),
        clear=bool(values[0] > CLEAR * whole),
        offset_A_per_Nm=offset_A,
        offset_stderr_A=offset_stderr_A,
        predicts=p_value < FALSE_SHARE
        and _predicts(problem, place, pair @ part, part.T @ cross, inverse, step),
    )


def _chance(problem: Weighted, place: int, gain: float, terms: int) -> float:
    """Return the probability of a gain by chance: by the noise, or by the scatter over points."""
    points = len(problem.rest)
    by_noise = stats.f.sf(gain / terms, terms, NOISE_FREEDOM * points)
    less = problem.scatter[place] / max(problem.scatter[place], 1.0)
    by_scatter = stats.f.sf(gain / terms / max(less, 1e-300), terms, 2 * max(points - 1, 1))
    return float(max(by_noise, by_scatter))


def _predicts(
    problem: Weighted,
    place: int,
    pair: np.ndarray,
    cross: np.ndarray,
    inverse: np.ndarray,
    step: np.ndarray,
) -> bool:
    """Return whether an order is the same at all torques.

    What other torques show of it lessens what is left at each torque, and an amplitude that grows
    with the torque, or with its square, does not explain more of it; both but for noise.
    """
    torques_Nm = np.unique(problem.torque_Nm)
    if torques_Nm.size < 2:
        return False
    effect = -problem.columns @ (inverse @ cross.T)  # (points, h, terms)
    effect[:, place] += pair
    rest = problem.rest - problem.columns @ step
    growing = max(_growing(problem, effect, rest, power) for power in (1, 2))
    if growing > _explained(effect, rest) + TOLERANCE:
        return False
    for torque_Nm in torques_Nm:
        out = problem.torque_Nm == torque_Nm
        others = effect[~out].reshape(-1, effect.shape[2])
        normal = (others.conj().T @ others).real
        size = np.linalg.lstsq(normal, (others.conj().T @ rest[~out].ravel()).real, rcond=None)[0]
        after = rest[out] - effect[out] @ size
        if (np.abs(after) ** 2).sum() > (np.abs(rest[out]) ** 2).sum() + TOLERANCE:
            return False
    return True


def _growing(problem: Weighted, effect: np.ndarray, rest: np.ndarray, power: int) -> float:
    """Return how much of the rest an effect explains that grows with a power of the torque."""
    scale = (problem.torque_Nm / problem.torque_Nm.max()) ** power
    return _explained(effect * scale[:, None, None], rest)


def _explained(effect: np.ndarray, rest: np.ndarray) -> float:
    flat = effect.reshape(-1, effect.shape[2])
    right = (flat.conj().T @ rest.ravel()).real
    return float(right @ np.linalg.lstsq((flat.conj().T @ flat).real, right, rcond=None)[0])


def in_a_row(orders: Iterable[int]) -> str:
    """Return "order 6" or "orders 6, 8", rising."""
    names = [str(order) for order in sorted(orders)]
    return ("order " if len(names) == 1 else "orders ") + ", ".join(names)


def unconfirmed(search: Search, harmonics: Sequence[Harmonic]) -> tuple[int, ...]:
    """Return the orders that entered whose amplitude in the fit is not above its noise.

    But for those that offsets imitate: they stay, and make the offsets' intervals as wide as the
    data have it.
    """
    added = {trial.order for trial in search.added if trial.clear}
    return tuple(
        h.order for h in harmonics if h.order in added and h.amplitude_Nm < CONFIRMED * h.stderr_Nm
    )


def significant(harmonics: Sequence[Harmonic], points: int) -> tuple[int, ...]:
    """Return the orders that are more than noise makes of any of so many, rising.

    Both parts of an amplitude count; their errors have the degrees of freedom of the points.
    """
    share = FALSE_SHARE / max(len(harmonics), 1)
    least = float(np.sqrt(2 * stats.f.isf(share, 2, 2 * max(points - 1, 1))))
    return tuple(sorted(h.order for h in harmonics if h.amplitude_Nm > least * h.stderr_Nm))
