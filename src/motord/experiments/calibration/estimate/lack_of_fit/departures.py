"""Which departures of a bench explain what a fit leaves.

Greedy forward selection: the effect that gains most in a score test is kept if that is more than
chance; of those that gain nearly as much, the one with fewest parameters. Then the same again with
it in the model. So it is known, too, how far each departure has moved the model's own parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from motord.experiments.calibration.estimate.lack_of_fit.effects import COGGING, Effect
from motord.experiments.calibration.estimate.lack_of_fit.score_test import (
    Gain,
    ResidualRows,
    WeighedRows,
)

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
"""Part of the largest line of the first departure: what leaves less counts as its second order."""

ROUNDS = 3
"""Fits by which the dispersion at each order settles."""


@dataclass(frozen=True)
class Cause:
    """A departure that explains more of the rest than chance would.

    size (terms,), in the effect's units; sigmas: by how many standard errors it is other than zero;
    rms_Nm: largest line that it leaves. alike: names of other departures that explain nearly as
    much. shifts (n, p): by how much it has moved the model's parameters, and what is alike would.
    """

    name: str
    order: int
    size: np.ndarray
    sigmas: float
    rms_Nm: float
    shifts: np.ndarray
    alike: tuple[str, ...]


@dataclass(frozen=True)
class Evidence:
    """What a fit leaves, and the effects that might explain it.

    further: rows (m, terms) of each effect in the rows' further ones.
    """

    rows: ResidualRows
    effects: Sequence[Effect]
    further: Sequence[np.ndarray]

    def with_effects(self, more: Sequence[Effect]) -> "Evidence":
        """Return the same with further effects, which Kirchhoff's law does not show."""
        of_law = [np.zeros((self.rows.further.size, one.lines.shape[1])) for one in more]
        return replace(self, effects=[*self.effects, *more], further=[*self.further, *of_law])

    def columns(self, weighed: WeighedRows, number: int) -> np.ndarray:
        """Return the rows (n, terms) of an effect."""
        return weighed.effect(self.effects[number].lines, self.further[number])

    def fitted(self, weighed: WeighedRows, chosen: Sequence[int]) -> WeighedRows:
        """Return the rows with the chosen effects in the model."""
        if not chosen:
            return weighed
        return weighed.with_columns(np.column_stack([self.columns(weighed, n) for n in chosen]))


def _rms(lines_Nm: np.ndarray) -> np.ndarray:
    """Return the RMS torque of lines (points, orders) over the points."""
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
    """Return which departures explain the rest of a fit.

    Orders of cogging torque among the effects compete with the departures but are none.
    subspace (p, k): what the columns of the rows' model stand for among its p parameters.
    """
    plain = evidence.rows.weighed(np.ones(evidence.rows.rest_Nm.shape[1]))
    columns = [evidence.columns(plain, number) for number in range(len(evidence.effects))]
    found: list[Cause] = []
    chosen: list[int] = []
    while len(found) < MAX_CAUSES and len(chosen) < MAX_CAUSES + MAX_ORDERS:
        so_far = evidence.fitted(plain, chosen)
        gains = so_far.gains(columns)
        best = _significant(evidence, chosen, gains)
        if best is None:
            break
        number, sigmas = best
        effect, size = evidence.effects[number], gains[number].size
        if effect.name == COGGING:
            chosen.append(number)
            continue
        rms_Nm = float(_rms(np.einsum("pth,t->ph", effect.lines, size)).max())
        if found and rms_Nm < MINOR_SHARE * found[0].rms_Nm:
            break
        alike = [n for n in _alike(evidence.effects, gains, number) if n not in chosen]
        own = slice(0, subspace.shape[1])
        moved = [
            evidence.fitted(plain, [*chosen, n]).solution[own] - so_far.solution[own]
            for n in (number, *alike)
        ]
        shifts = np.array(moved) @ subspace.T
        names = tuple(sorted({evidence.effects[n].name for n in alike}))
        found.append(Cause(effect.name, effect.order, size, sigmas, rms_Nm, shifts, names))
        chosen.append(number)
    fitted = evidence.fitted(plain, chosen)
    return ExplainedFit(tuple(found), _caused(evidence, chosen, fitted), tuple(chosen), fitted)


def _caused(evidence: Evidence, chosen: Sequence[int], fitted: WeighedRows) -> np.ndarray:
    """Return the lines (points, orders) of the chosen effects, in the sizes of a fit with them."""
    lines = np.zeros_like(evidence.rows.rest_Nm)
    place = evidence.rows.columns.shape[1]
    for effect in (evidence.effects[number] for number in chosen):
        end = place + effect.lines.shape[1]
        if effect.name != COGGING:
            lines += np.einsum("pth,t->ph", effect.lines, fitted.solution[place:end])
        place = end
    return lines


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


def _significant(
    evidence: Evidence, chosen: Sequence[int], gains: Sequence[Gain]
) -> tuple[int, float] | None:
    """Return the first effect, as ranked, that is more than chance, and its standard errors.

    Order by order: the noise at an order is the measured one, or what the fit leaves there over the
    points, if that is more. And it has to be there in all groups of turns alike.
    """
    samples = evidence.rows.rest_Nm.size
    level = FALSE_SHARE / len(evidence.effects)
    for number in _ranked(gains, chosen):
        if _p_value(gains[number], samples) > level:
            continue
        dispersion = np.ones(evidence.rows.rest_Nm.shape[1])
        for _ in range(ROUNDS):
            weighed = evidence.rows.weighed(dispersion)
            left = evidence.fitted(weighed, [*chosen, number]).left_lines(evidence.rows)
            dispersion = np.maximum((np.abs(left / evidence.rows.noise_Nm) ** 2).mean(axis=0), 1.0)
        weighed = evidence.rows.weighed(dispersion)
        columns = evidence.columns(weighed, number)
        so_far = evidence.fitted(weighed, chosen)
        [gain] = so_far.gains([columns])
        if gain.terms and _p_value(gain, samples) <= level:
            t, freedom = so_far.robust_t(evidence.rows, columns @ gain.size)
            if 2 * stats.t.sf(abs(t), freedom) <= level:
                return number, float(min(np.sqrt(gain.chi_square), abs(t)))
    return None


def _p_value(gain: Gain, freedom: int) -> float:
    """Return the probability of so much by chance; freedom: of the noise's estimate."""
    return float(stats.f.sf(gain.chi_square / gain.terms, gain.terms, freedom))
