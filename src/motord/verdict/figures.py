"""Figures with their combined standard uncertainty from the JSON result of an analysis."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import hypot, inf, isclose
from typing import Any

from motord.config.figures import FigureKind
from motord.intervals import coverage_factor, standard_uncertainty
from motord.results.figures import element_of, error_keys, finite_number, freedom_of_all
from motord.uncertainty_budget import Contribution, totals
from motord.verdict.decision import Figure

Selection = Mapping[str, str | float]
"""Values of the keys that separate the rows of a figure, such as {"order": 48}."""

PHASES = "abc"


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
) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield what separates each row from the others, and what it states of the value, by role."""
    for row in result.get(kind.rows) or () if kind.rows else (result,):
        freedom = freedom_of_all(row) or freedom_of_all(result)
        freedom = freedom.get(kind.value) if isinstance(freedom, Mapping) else freedom
        errors = error_keys(row).get(kind.value, {})
        parts = {"value": row.get(kind.value), "freedom": freedom}
        parts |= {role: row[key] for role, key in errors.items()}
        if kind.by != ("phase",):
            yield {key: row[key] for key in kind.by}, parts
            continue
        for place, phase in enumerate(PHASES):
            yield {"phase": phase}, {key: element_of(part, place) for key, part in parts.items()}


def _equal(one: Any, other: str | float) -> bool:
    if isinstance(other, str) or isinstance(one, str):
        return bool(one == other)
    return isclose(float(one), other, rel_tol=1e-9)


def _name(name: str, key: Mapping[str, Any]) -> str:
    parts = (f"{k} {v}" if isinstance(v, str) else f"{k} {v:g}" for k, v in key.items())
    return ", ".join([name, *parts])


def _figure(
    kind: FigureKind, key: Mapping[str, Any], row: Mapping[str, Any], result: Mapping[str, Any]
) -> Figure:
    """Return the figure of a row; freedom of Type A and Type B together: Welch-Satterthwaite."""
    value, type_b = finite_number(row["value"]), 0.0
    type_a, freedom, known = _type_a(row)
    name = _name(kind.name, key)
    if kind.budget:
        budget = [Contribution.model_validate(one) for one in result.get("budget", ())]
        if not budget:
            return Figure(name, kind.unit, value, None, None, "it has no uncertainty budget")
        data, others, _ = totals(budget)
        type_b = _of_budget(others, kind, key)
        type_a = type_a if "stderr" in row else _of_budget(data, kind, key)
    if type_a is None or not type_a > 0:
        return Figure(name, kind.unit, value, None, None, "its uncertainty is not stated")
    whole = hypot(type_a, type_b)
    wide = None if freedom is None else max(freedom, 1.0) * (whole / type_a) ** 4
    return Figure(name, kind.unit, value, whole, wide, freedom_known=known)


def _type_a(row: Mapping[str, Any]) -> tuple[float | None, float | None, bool]:
    """Return the standard error, its degrees of freedom, None for many, and if these are known."""
    roles = ("value", "stderr", "low", "high", "freedom")
    value, stderr, low, high, freedom = (finite_number(row.get(role)) for role in roles)
    if freedom is not None and stderr is None and low is not None and high is not None:
        return (high - low) / 2 / coverage_factor(freedom), freedom, True
    if freedom is not None or value is None:
        return stderr, freedom, True
    return standard_uncertainty(value, stderr, low, high) or (None, None, True)


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
    fewest = min(inf if (f := one.degrees_of_freedom) is None else f for one in figures)
    freedom, known = None if fewest == inf else fewest, all(one.freedom_known for one in figures)
    n, value, u = len(figures), max(values) - min(values), sum(each[-2:])
    if kind.combine == "mean":
        value, u = sum(values) / n, sum(each) / n
    return Figure(name, kind.unit, value, u, freedom, freedom_known=known)
