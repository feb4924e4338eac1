"""Cogging orders beyond those that slots and poles allow, where the data show them.

Forward selection: all orders of the turn are tried, the best enters, and again with it. And what
the search adds to a calibration: orders, notes, findings.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from scipy.special import chdtri, ndtri

from motord.calibration import Harmonic
from motord.experiments.calibration.estimate.lack_of_fit.departures import FALSE_SHARE
from motord.experiments.calibration.estimate.order_trial import (
    TOLERANCE,
    OrderTrial,
    Weighted,
    tried,
)
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.findings import Finding
from motord.intervals import f_quantile, t_quantile, two_digits

FIRST_ORDER = 2
"""Lowest order that is tried: mean and slope of each turn, which drift makes, are most of order 1.
"""

OFFSET_SHARE = 0.01
"""Part of the rated current that the offsets have to be known to with an order for it to enter."""

MAX_ADDED = 12
"""Orders that enter at most: each costs time and memory."""

HINT = 0.01
"""Probability by chance below which an order that did not enter still counts for the offsets."""

MANY = 1e9
"""Degrees of freedom where they are not known: so many that it makes no difference."""

FALSE_CONFIRMATION = 0.0027
"""Probability that noise confirms an order in the fit to all samples, that of 3 sigma."""

MEASURE_APART = (
    "measure the offsets at rest, or the cogging torque without currents (`motord plan start "
    "cogging`)"
)


@dataclass(frozen=True)
class Search:
    """Orders that entered, of all that were tried with their levels, over how many turns.

    imitated: those that did not, and that the currents' offsets can imitate. instead: pairs of an
    order that entered and one that would explain as much in its place. inseparable: orders that
    the data show, and with which the currents' offsets would not be known.
    """

    added: tuple[OrderTrial, ...]
    imitated: tuple[OrderTrial, ...]
    instead: tuple[tuple[int, int], ...]
    inseparable: tuple[int, ...]
    levels: Mapping[int, float]
    turns: int

    def without(self, orders: Sequence[int]) -> "Search":
        """Return the search with these orders out again."""
        return replace(
            self,
            added=tuple(one for one in self.added if one.order not in orders),
            instead=tuple(pair for pair in self.instead if pair[0] not in orders),
        )


def search(problem: Weighted, known: Sequence[int], pole_pairs: int) -> Search:
    """Return the orders that enter in addition to those that are `known`, by forward selection."""
    added: list[OrderTrial] = []
    rivals: list[tuple[int, int]] = []
    candidates = [o for o in range(FIRST_ORDER, problem.residual.shape[1] + 1) if o not in known]
    level = levels(candidates, pole_pairs)
    most_A = OFFSET_SHARE * problem.rated_A
    while True:
        trials = tried(problem, candidates)
        shown = [trial for trial in trials if trial.enters(level[trial.order])]
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
        trial for trial in trials if _like_offsets(trial.order, pole_pairs) and not trial.clear
    )
    orders = {trial.order for trial in added}
    instead = tuple(pair for pair in rivals if pair[1] not in orders and 0 not in pair)
    inseparable = {pair[0] for pair in rivals if not pair[1]} - {pair[1] for pair in instead}
    return Search(tuple(added), imitated, instead, tuple(sorted(inseparable)), level, problem.turns)


def levels(orders: Sequence[int], pole_pairs: int) -> dict[int, float]:
    """Return the p-value below which each order enters; by chance any does in FALSE_SHARE.

    Half of that is for the orders that offsets of the currents have too (weighted Bonferroni):
    they are few, and one that is there and left out spoils the offsets.
    """
    like = [order for order in orders if _like_offsets(order, pole_pairs)]
    share = FALSE_SHARE / 2
    return {
        order: share / (len(like) if order in like else len(orders) - len(like)) for order in orders
    }


def _like_offsets(order: int, pole_pairs: int) -> bool:
    """Return whether offsets of the currents make torque of that order: p, 3 p, 5 p, ..."""
    return order % (2 * pole_pairs) == pole_pairs


def with_added_orders(
    result: CalibrationResult, found: Search, common_offset_lost: bool, pole_pairs: int
) -> CalibrationResult:
    """Return the result with what the search found.

    Orders that did not enter, but that the data hint at, widen the intervals of the offsets.
    common_offset_lost: whether the offset that all phases have in common was seen before orders
    were added, and is not with them.
    """
    harmonics = result.harmonics
    shown = significant(harmonics)
    clearly = in_a_row(shown) if shown else "at no order"
    if few := undecided(harmonics):
        clearly += f"; too few operating points to tell: {in_a_row(few)}"
    return replace(
        result,
        beta_stderr_A=np.sqrt(result.beta_stderr_A**2 + _hinted_A2(found)),
        added_orders=tuple(trial.entered() for trial in found.added),
        observable=(*result.observable, *_notes(found), f"significant cogging torque: {clearly}"),
        findings=(
            *result.findings,
            *_findings(found, harmonics),
            *_hidden(found),
            *(_common_offset(harmonics, pole_pairs) if common_offset_lost else ()),
        ),
    )


def unconfirmed(found: Search, harmonics: Sequence[Harmonic], least_Nm: float) -> tuple[int, ...]:
    """Return the orders that entered whose amplitude in the fit is not above noise and `least_Nm`.

    But for those that offsets imitate: they stay, and make the offsets' intervals as wide as the
    data have it.
    """
    added = {trial.order for trial in found.added if trial.clear}
    return tuple(
        h.order
        for h in harmonics
        if h.order in added and h.amplitude_Nm < max(_confirmed_Nm(h), least_Nm)
    )


def significant(harmonics: Sequence[Harmonic]) -> tuple[int, ...]:
    """Return the orders that are more than noise makes of any of so many; both parts count."""
    share = FALSE_SHARE / max(len(harmonics), 1)
    return tuple(
        h.order
        for h in harmonics
        if (h.amplitude_Nm / max(h.stderr_Nm or 0.0, 1e-300)) ** 2
        > 2 * f_quantile(1.0 - share, 2, h.degrees_of_freedom or MANY)
    )


def undecided(harmonics: Sequence[Harmonic]) -> tuple[int, ...]:
    """Return the orders that would be significant with many degrees of freedom, and are not."""
    known = [h.model_copy(update={"degrees_of_freedom": None}) for h in harmonics]
    return tuple(order for order in significant(known) if order not in significant(harmonics))


def in_a_row(orders: Iterable[int]) -> str:
    """Return "order 6" or "orders 6, 8", rising."""
    names = [str(order) for order in sorted(orders)]
    return ("order " if len(names) == 1 else "orders ") + ", ".join(names)


def _confirmed_Nm(harmonic: Harmonic) -> float:
    quantile = t_quantile(1 - FALSE_CONFIRMATION / 2, harmonic.degrees_of_freedom or np.inf)
    return quantile * (harmonic.stderr_Nm or 0.0)


def _findings(found: Search, harmonics: Sequence[Harmonic]) -> Iterator[Finding]:
    """Yield a finding for each order that the data cannot separate from others or from offsets."""
    for order in found.inseparable:
        yield Finding(
            f"offsets-or-cogging-order-{order}", float(order), 0.0, "per turn", "serious",
            f"cogging torque of order {order} is there, but these points do not separate it from "
            "offsets of the currents: it was taken for these, which are wrong",
            MEASURE_APART,
        )  # fmt: skip
    for order, other in found.instead:
        [h] = [h for h in harmonics if h.order == order]
        yield Finding(
            f"cogging-order-{order}-or-{other}", 1e3 * h.amplitude_Nm, 1e3 * _confirmed_Nm(h),
            "mNm", "serious",
            f"cogging torque of order {order}, with other offsets of the currents, and of order "
            f"{other} explain the torque alike: the offsets' intervals hold for order {order}",
            MEASURE_APART,
        )  # fmt: skip


def _hidden(found: Search) -> Iterator[Finding]:
    """Yield a finding for each order of which offsets hide a part, and the rest is hinted at."""
    for trial in found.imitated:
        if np.isnan(trial.stderr_Nm) and trial.p_value < HINT:
            yield Finding(
                "common-offset-or-cogging", 1e3 * trial.part_Nm,
                1e3 * -float(ndtri(HINT / 2)) * trial.part_stderr_Nm, "mNm", "warning",
                f"there seems to be cogging torque of order {trial.order}, and an offset "
                "that all phases have in common looks like it but for its phase: their sum is "
                "right, it was taken for that offset, whose interval holds as much of it again",
                f"more operating points decide it (over {len(found.levels)} orders tried it may be "
                "chance); measure the offsets at rest",
            )  # fmt: skip


def _common_offset(harmonics: Sequence[Harmonic], pole_pairs: int) -> Iterator[Finding]:
    """Yield a finding: common offset and cogging at odd multiples of 3 p make the same torque."""
    alike = [h for h in harmonics if h.order % (6 * pole_pairs) == 3 * pole_pairs]
    for h in sorted(alike, key=attrgetter("order"))[:1]:
        yield Finding(
            "common-offset-or-cogging", 1e3 * h.amplitude_Nm, 1e3 * _confirmed_Nm(h), "mNm",
            "warning",
            f"cogging torque of order {h.order} and an offset that all phases have in "
            "common look alike: their sum is right, the offset was taken as none",
            "measure the offsets at rest; in a star the sensed currents show their sum",
        )  # fmt: skip


def _notes(found: Search) -> Iterator[str]:
    """Yield which orders were added and why, and which could not be separated from offsets."""
    if found.added:
        names = in_a_row(trial.order for trial in found.added)
        yield (
            f"cogging {names} added, which slots and poles do not allow: there at all torques "
            f"alike, less than {100 * FALSE_SHARE:g} % by chance over the {len(found.levels)} "
            f"orders tried, and worth it by BIC with {found.turns} turns"
        )
    for trial in found.imitated:
        yield _imitated(trial, found.levels[trial.order])


def _imitated(trial: OrderTrial, level: float) -> str:
    if np.isnan(trial.stderr_Nm):
        return (
            f"cogging order {trial.order} and the currents' offsets cannot be separated: taken "
            f"as offsets, which 1 mNm of it moves by {1e-3 * trial.offset_A_per_Nm:.2g} A"
        )
    if trial.p_value < HINT:
        return (
            f"cogging order {trial.order}: taken as none, though less than {100 * HINT:g} % "
            "probable by chance; the offsets' intervals hold what they would be with it"
        )
    most_Nm = float(np.sqrt(chdtri(2, level))) * trial.stderr_Nm
    return (
        f"cogging order {trial.order}: taken as none; less than "
        f"{two_digits(1e3 * most_Nm)} mNm would not be noticed, and moves "
        f"the currents' offsets by up to {most_Nm * trial.offset_A_per_Nm:.2g} A"
    )


def _hinted_A2(found: Search) -> np.ndarray:
    """Return the squares by which the offsets (3,) would move with orders that are hinted at."""
    shifts = [trial.offset_shift_A for trial in found.imitated if trial.p_value < HINT]
    return np.asarray(sum((shift**2 for shift in shifts), np.zeros(3)))
