"""What a search for further cogging orders adds to a calibration: orders, notes, findings."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from operator import attrgetter

import numpy as np
from scipy.special import chdtri, ndtri

from motord.calibration import Harmonic
from motord.experiments.calibration.estimate.more_orders.search import Search
from motord.experiments.calibration.estimate.more_orders.trial import FALSE_SHARE, OrderTrial
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.findings import Finding
from motord.intervals import f_quantile, t_quantile

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
            name=f"offsets-or-cogging-order-{order}",
            value=float(order),
            limit=0.0,
            unit="per turn",
            severity="serious",
            meaning=f"cogging torque of order {order} is there, but these points do not separate "
            "it from offsets of the currents: it was taken for these, which are wrong",
            action=MEASURE_APART,
        )
    for order, other in found.instead:
        [h] = [h for h in harmonics if h.order == order]
        yield Finding(
            name=f"cogging-order-{order}-or-{other}",
            value=1e3 * h.amplitude_Nm,
            limit=1e3 * _confirmed_Nm(h),
            unit="mNm",
            severity="serious",
            meaning=f"cogging torque of order {order}, with other offsets of the currents, and "
            f"of order {other} explain the torque alike: the offsets' intervals hold for "
            f"order {order}",
            action=MEASURE_APART,
        )


def _hidden(found: Search) -> Iterator[Finding]:
    """Yield a finding for each order of which offsets hide a part, and the rest is hinted at."""
    for trial in found.imitated:
        if np.isnan(trial.stderr_Nm) and trial.p_value < HINT:
            yield Finding(
                name="common-offset-or-cogging",
                value=1e3 * trial.part_Nm,
                limit=1e3 * -float(ndtri(HINT / 2)) * trial.part_stderr_Nm,
                unit="mNm",
                severity="warning",
                meaning=f"there seems to be cogging torque of order {trial.order}, and an offset "
                "that all phases have in common looks like it but for its phase: their sum is "
                "right, it was taken for that offset, whose interval holds as much of it again",
                action=f"more operating points decide it (over {len(found.levels)} orders tried "
                "it may be chance); measure the offsets at rest",
            )


def _common_offset(harmonics: Sequence[Harmonic], pole_pairs: int) -> Iterator[Finding]:
    """Yield a finding: common offset and cogging at odd multiples of 3 p make the same torque."""
    alike = [h for h in harmonics if h.order % (6 * pole_pairs) == 3 * pole_pairs]
    for h in sorted(alike, key=attrgetter("order"))[:1]:
        yield Finding(
            name="common-offset-or-cogging",
            value=1e3 * h.amplitude_Nm,
            limit=1e3 * _confirmed_Nm(h),
            unit="mNm",
            severity="warning",
            meaning=f"cogging torque of order {h.order} and an offset that all phases have in "
            "common look alike: their sum is right, the offset was taken as none",
            action="measure the offsets at rest; in a star the sensed currents show their sum",
        )


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
        f"cogging order {trial.order}: taken as none; less than {1e3 * most_Nm:.2g} mNm would not "
        f"be noticed, and moves the currents' offsets by up to "
        f"{most_Nm * trial.offset_A_per_Nm:.2g} A"
    )


def _hinted_A2(found: Search) -> np.ndarray:
    """Return the squares by which the offsets (3,) would move with orders that are hinted at."""
    shifts = [trial.offset_shift_A for trial in found.imitated if trial.p_value < HINT]
    return np.asarray(sum((shift**2 for shift in shifts), np.zeros(3)))
