"""Figures with their combined standard uncertainty from JSON results of analyses; the verdict."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import hypot, isclose
from typing import Any

from motord.config.figures import FigureKind
from motord.intervals import coverage_factor, standard_uncertainty
from motord.results.figures import StatedQuantity, error_keys, freedoms, stated_quantity
from motord.uncertainty_budget import Contribution, totals
from motord.verdict.decision import Figure, FigureVerdict, MotorVerdict, decide
from motord.verdict.motor_type import MotorType

Selection = Mapping[str, str | float]
"""Values of the keys that separate the rows of a figure, such as {"order": 48}."""

PHASES = "abc"

BUDGETS = ("alpha", "beta_A", "delta_epsilon", "cogging_Nm")
"""What `FigureKind.budget` may be, as a contribution's degrees of freedom are in order."""


def figures_of(kind: FigureKind, result: Mapping[str, Any], at: Selection) -> tuple[Figure, ...]:
    """Return the figures of a kind, those that `at` selects; one without a value if there are none.

    A result with serious findings, whose intervals are too narrow, puts a doubt on each.
    """
    doubt = _serious(result)
    found = [
        _figure(kind, key, row, result)
        for key, row in _rows(kind, result)
        if all(_equal(key[name], value) for name, value in at.items())
    ]
    name = _name(kind.name, at)
    if not found:
        return (Figure(name, kind.unit, None, None, None, "it is not in the result"),)
    if kind.combine:
        found = [_combined(kind, name, found)]
    return tuple(replace(one, doubt=doubt or one.doubt) for one in found)


def _serious(result: Mapping[str, Any]) -> str:
    names = [one["name"] for one in result.get("findings") or () if one["severity"] == "serious"]
    return f"serious finding {', '.join(dict.fromkeys(names))}" if names else ""


def _rows(
    kind: FigureKind, result: Mapping[str, Any]
) -> Iterator[tuple[dict[str, Any], StatedQuantity]]:
    """Yield what separates each row from the others, and what it states of the figure."""
    around = freedoms(result)
    for row in result.get(kind.rows) or () if kind.rows else (result,):
        errors = error_keys(row, (kind.value,) if kind.leading else ()).get(kind.value, {})
        if kind.by != ("phase",):
            stated = stated_quantity(row, kind.value, errors, around)
            yield {key: row[key] for key in kind.by}, stated
            continue
        for place, phase in enumerate(PHASES):
            yield {"phase": phase}, stated_quantity(row, kind.value, errors, around, place)


def _equal(one: Any, other: str | float) -> bool:
    if isinstance(other, str) or isinstance(one, str):
        return bool(one == other)
    return isclose(float(one), other, rel_tol=1e-9)


def _name(name: str, key: Mapping[str, Any]) -> str:
    parts = (f"{k} {v}" if isinstance(v, str) else f"{k} {v:g}" for k, v in key.items())
    return ", ".join([name, *parts])


def _figure(
    kind: FigureKind, key: Mapping[str, Any], row: StatedQuantity, result: Mapping[str, Any]
) -> Figure:
    """Return the figure of a row; freedom of Type A and Type B together: Welch-Satterthwaite."""
    value, type_b = row.value, 0.0
    type_a, freedom, known = _type_a(row)
    name = _name(kind.name, key)
    if kind.budget:
        budget = [Contribution.model_validate(one) for one in result.get("budget", ())]
        if not budget:
            return Figure(name, kind.unit, value, None, None, "it has no uncertainty budget")
        data, others, _ = totals(budget)
        type_b = _of_budget(others, kind, key)
        if not row.of_error:
            type_a = _of_budget(data, kind, key)
            freedom = _fewer(freedom, data.degrees_of_freedom[BUDGETS.index(kind.budget)])
    if type_a is None or not type_a > 0:
        return Figure(name, kind.unit, value, None, None, "its uncertainty is not stated")
    whole = hypot(type_a, type_b)
    wide = None if freedom is None else max(freedom, 1.0) * (whole / type_a) ** 4
    return Figure(name, kind.unit, value, whole, wide, freedom_known=known)


def _type_a(row: StatedQuantity) -> tuple[float | None, float | None, bool]:
    """Return the standard error, its degrees of freedom, None for many, and if these are known.

    Where degrees of freedom, standard error and interval are stated, the fewest freedom counts.
    """
    if row.value is None:
        return row.stderr, row.freedom, True
    found = standard_uncertainty(row.value, row.stderr, row.low, row.high)
    if found is None:
        return None, row.freedom, True
    if row.freedom is None or (row.stderr is not None and not found.known):
        return found
    factor = coverage_factor(row.freedom)
    if row.stderr is None:  # that of the normal distribution, from an interval by Student's t
        return found.value * coverage_factor() / factor, row.freedom, True
    if found.freedom is None or found.freedom * (1 + 1e-6) >= row.freedom:
        return found.value, row.freedom, True
    return found


def _fewer(one: float | None, other: float | None) -> float | None:
    """Return the fewer of degrees of freedom, None being many."""
    return min((f for f in (one, other) if f is not None), default=None)


def _of_budget(total: Contribution, kind: FigureKind, key: Mapping[str, Any]) -> float:
    part = getattr(total, kind.budget)
    return float(part[PHASES.index(key["phase"])] if isinstance(part, tuple) else part)


def _combined(kind: FigureKind, name: str, figures: Sequence[Figure]) -> Figure:
    """Return spread or mean of figures.

    The standard uncertainty is what it is at most, however their errors are correlated: of a mean,
    the mean; of a spread, the sum of the two largest. Of the degrees of freedom the fewest count.
    """
    values = [one.value for one in figures if one.value is not None]
    each = sorted(u for one in figures if (u := one.standard_uncertainty) is not None)
    if len(values) < len(figures) or len(each) < len(figures):
        return Figure(name, kind.unit, None, None, None, "an uncertainty is not stated")
    freedom, known = None, all(one.freedom_known for one in figures)
    for one in figures:
        freedom = _fewer(freedom, one.degrees_of_freedom)
    n, value, u = len(figures), max(values) - min(values), sum(each[-2:])
    if kind.combine == "mean":
        value, u = sum(values) / n, sum(each) / n
    return Figure(name, kind.unit, value, u, freedom, freedom_known=known)


def judge(motor_type: MotorType, results: Mapping[str, Mapping[str, Any]]) -> MotorVerdict:
    """Return the verdict of a motor; results: JSON results by analysis."""
    decisions: list[FigureVerdict] = []
    for limit in motor_type.limit:
        kind, result = limit.kind, results.get(limit.analysis)
        if result is None:
            why = f"there is no recording for {limit.analysis}"
            figures: tuple[Figure, ...] = (Figure(kind.name, kind.unit, None, None, None, why),)
        else:
            figures = figures_of(kind, result, limit.at)
        for figure in figures:
            named = replace(figure, analysis=limit.analysis)
            decisions.append(decide(named, limit.tolerance, motor_type.risk))
    return MotorVerdict(tuple(decisions))
