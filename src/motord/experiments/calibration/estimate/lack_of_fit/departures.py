"""Which departures of a bench explain the residual of a fit.

Forward selection: the effect with the largest score statistic (reduction of chi-square) enters the
model if it is significant; of those with nearly as large a statistic, the one with fewest
parameters. Repeated until none is. The shift of the model's own parameters by each is kept.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr

from motord.experiments.calibration.estimate.lack_of_fit.effects import COGGING, Effect
from motord.experiments.calibration.estimate.lack_of_fit.evidence import Evidence
from motord.experiments.calibration.estimate.lack_of_fit.gain_scatter import (
    GainDirections,
    GainScatter,
)
from motord.experiments.calibration.estimate.lack_of_fit.score_test import (
    Gain,
    WeighedRows,
)
from motord.identification.variance_components import MOST_FREEDOM
from motord.intervals import f_tail

FALSE_SHARE = 0.002
"""Probability that noise is taken for a departure, or for an order, over all that are tried."""

LOOKED_AT = 5
"""Effects that gain most, of which one may be kept."""

MAX_CAUSES = 4
"""Departures that are kept at most."""

MAX_ORDERS = 16
"""Orders of cogging torque that are kept at most, where they are tried."""

EXPLAINS_AS_WELL = 0.9
"""Part of the most that is gained from which on an effect cannot be separated from the best."""

MINOR_SHARE = 0.15
"""Part of the largest line of the first departure: smaller ones count as its second order."""

ROUNDS = 3
"""Fits by which the dispersion at each order settles."""


@dataclass(frozen=True)
class Cause:
    """A departure that explains more of the residual than chance would.

    size (terms,), in the effect's units; sigmas: by how many standard errors it is other than zero;
    rms_Nm: its largest line. alike: names of other departures that explain nearly as
    much. shifts (n, p): by how much it has moved the model's parameters, and what is alike would.
    """

    name: str
    order: int
    size: np.ndarray
    sigmas: float
    rms_Nm: float
    shifts: np.ndarray
    alike: tuple[str, ...]


def rms_Nm(lines_Nm: np.ndarray) -> np.ndarray:
    """Return the RMS torque (...) of lines (points, ...) over the points."""
    return np.asarray(np.sqrt((np.abs(lines_Nm) ** 2).mean(axis=0) / 2))


@dataclass(frozen=True)
class ExplainedFit:
    """The departures that are there, their lines (points, orders) at the model's parameters, the
    places of their effects, and the fit of model and departures together."""

    causes: tuple[Cause, ...]
    caused_Nm: np.ndarray
    chosen: tuple[int, ...]
    fitted: WeighedRows


def explain(evidence: Evidence, subspace: np.ndarray) -> ExplainedFit:
    """Return which departures explain the residual of a fit.

    Orders of cogging torque among the effects compete with the departures but are none.
    subspace (p, k): what the columns of the rows' model stand for among its p parameters.
    """
    plain, terms = evidence.plain, evidence.terms
    columns = evidence.all_columns(plain)
    found: list[Cause] = []
    chosen: list[int] = []
    while len(found) < MAX_CAUSES and len(chosen) < MAX_CAUSES + MAX_ORDERS:
        gains = evidence.fitted(plain, chosen).gains(columns, terms)
        best = _significant(evidence, chosen, gains)
        if best is None:
            break
        if evidence.effects[best.number].name != COGGING:
            cause = _cause(evidence, chosen, best, subspace)
            if found and cause.rms_Nm < MINOR_SHARE * found[0].rms_Nm:
                break
            found.append(cause)
        chosen.append(best.number)
    fitted = evidence.fitted(evidence.weighed(_gain_variance(evidence, chosen)), chosen)
    sizes, caused_Nm = _sizes(evidence, chosen, fitted), np.zeros_like(evidence.rows.residual_Nm)
    for effect, size in sizes:
        caused_Nm += np.einsum("pth,t->ph", effect.lines, size)
    causes = tuple(replace(cause, size=size) for cause, (_, size) in zip(found, sizes, strict=True))
    return ExplainedFit(causes, caused_Nm, tuple(chosen), fitted)


def _sizes(
    evidence: Evidence, chosen: Sequence[int], fitted: WeighedRows
) -> list[tuple[Effect, np.ndarray]]:
    """Return the chosen departures with their sizes in a fit with all: each would bias the others.

    Orders of cogging torque are none.
    """
    effects = [evidence.effects[number] for number in chosen]
    ends = np.cumsum([evidence.rows.columns.shape[1], *(one.lines.shape[1] for one in effects)])
    sizes = np.split(fitted.solution, ends)[1:-1]
    pairs = zip(effects, sizes, strict=True)
    return [(effect, size) for effect, size in pairs if effect.name != COGGING]


@dataclass(frozen=True)
class _Shown:
    """An effect that is more than chance, by how many standard errors; gain_variance: from point to
    point, with it in the model."""

    number: int
    sigmas: float
    gain_variance: float


def _cause(evidence: Evidence, chosen: Sequence[int], shown: _Shown, subspace: np.ndarray) -> Cause:
    """Return an effect that was found, with its shift of the model that has those chosen."""
    weighed, effect = evidence.weighed(shown.gain_variance), evidence.effects[shown.number]
    current = evidence.fitted(weighed, chosen)
    gains = current.gains(evidence.all_columns(weighed), evidence.terms)
    size = gains[shown.number].size
    alike = [n for n in _alike(evidence.effects, gains, shown.number) if n not in chosen]
    own = slice(0, subspace.shape[1])
    moved = [
        evidence.fitted(weighed, [*chosen, n]).solution[own] - current.solution[own]
        for n in (shown.number, *alike)
    ]
    return Cause(
        name=effect.name,
        order=effect.order,
        size=size,
        sigmas=shown.sigmas,
        rms_Nm=float(rms_Nm(np.einsum("pth,t->ph", effect.lines, size)).max()),
        shifts=np.array(moved) @ subspace.T,
        alike=tuple(sorted({evidence.effects[n].name for n in alike})),
    )


def _alike(effects: Sequence[Effect], gains: Sequence[Gain], number: int) -> list[int]:
    """Return the effects of other names that gain nearly as much as one."""
    least = EXPLAINS_AS_WELL * gains[number].chi_square
    name = effects[number].name
    return [n for n, one in enumerate(gains) if effects[n].name != name and one.chi_square >= least]


def _ranked(gains: Sequence[Gain], chosen: Sequence[int]) -> list[int]:
    """Return the effects by what they gain; of those that gain nearly the most, the simplest."""
    open_ = [n for n, gain in enumerate(gains) if gain.terms and n not in chosen]
    most = max((gains[n].chi_square for n in open_), default=0.0)

    def rank(n: int) -> tuple[bool, int, float]:
        nearly = gains[n].chi_square >= EXPLAINS_AS_WELL * most
        return not nearly, gains[n].terms * nearly, -gains[n].chi_square

    return sorted(open_, key=rank)[:LOOKED_AT]


def _significant(evidence: Evidence, chosen: Sequence[int], gains: Sequence[Gain]) -> _Shown | None:
    """Return the first effect, as ranked, that is more than chance.

    And it has to be there in all groups of turns alike.
    """
    rows, samples = evidence.rows, evidence.rows.residual_Nm.size
    level = FALSE_SHARE / len(evidence.effects)
    for number in _ranked(gains, chosen):
        if _p_value(gains[number], samples) > level:
            continue
        noise = _Noise.of(evidence, [*chosen, number])
        weighed = rows.weighed(noise.dispersion, noise.scatter.variance)
        columns = evidence.columns(weighed, number)
        current = evidence.fitted(weighed, chosen)
        [gain] = current.gains(columns, [columns.shape[1]])
        effect = columns @ gain.size
        freedom = min(samples, noise.freedom(current.orthogonal(effect), current.directions))
        if gain.terms and _p_value(gain, freedom) <= level:
            t, freedom = current.robust_t(rows, effect)
            if 2 * stdtr(freedom, -abs(t)) <= level:
                sigmas = float(min(np.sqrt(gain.chi_square), abs(t)))
                return _Shown(number, sigmas, noise.scatter.variance)
    return None


@dataclass(frozen=True)
class _Noise:
    """Noise by the residual: at an order the measured one, or the residual there over the points,
    if that is more, besides what gains make that differ from point to point.

    dispersion (orders,): variance in parts of the measured one; order_freedom (orders,).
    """

    dispersion: np.ndarray
    order_freedom: np.ndarray
    scatter: GainScatter

    @classmethod
    def of(cls, evidence: Evidence, chosen: Sequence[int]) -> "_Noise":
        """Return the noise with the chosen effects in the model."""
        rows, scatter = evidence.rows, GainScatter()
        dispersion = np.ones(rows.residual_Nm.shape[1])
        for _ in range(ROUNDS):
            fitted = evidence.fitted(rows.weighed(dispersion, scatter.variance), chosen)
            scatter = fitted.gain_scatter()
            if scatter.variance != fitted.gain_variance:
                fitted = evidence.fitted(rows.weighed(dispersion, scatter.variance), chosen)
            left, freedom = fitted.dispersion()
            dispersion = np.maximum(dispersion * left, 1.0)
        return cls(dispersion, freedom, scatter)

    def freedom(self, effect: np.ndarray, directions: GainDirections) -> float:
        """Return the degrees of freedom (Satterthwaite) of the variance along an effect (n,)."""
        effect = effect / max(float(np.linalg.norm(effect)), 1e-300)
        points, orders = len(directions.spread), self.dispersion.size
        at_order = (effect[: 2 * points * orders] ** 2).reshape(-1, orders).sum(axis=0)
        estimated = self.dispersion > 1
        doubt = float((2 * at_order**2 / self.order_freedom)[estimated].sum())
        along = directions.parts(effect[:, None]).ravel() ** 2
        doubt += self.scatter.doubt_of(along, directions.spread.ravel())
        return 2 / max(doubt, 2 / MOST_FREEDOM)


def _gain_variance(evidence: Evidence, chosen: Sequence[int]) -> float:
    """Return by how much gains differ from point to point, with the chosen effects."""
    variance = 0.0
    for _ in range(ROUNDS):
        variance = evidence.fitted(evidence.weighed(variance), chosen).gain_scatter().variance
        if not variance:
            break
    return variance


def _p_value(gain: Gain, freedom: float) -> float:
    """Return the probability of so much by chance; freedom: of the noise's estimate."""
    return float(f_tail(gain.chi_square / gain.terms, gain.terms, freedom))
