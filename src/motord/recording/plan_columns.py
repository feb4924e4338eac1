"""Name and settings of a recording's plan as columns, the same in all tables of recordings."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from motord.recording.json_encoding import to_json, without_surrogates

PLAN = "plan"
"""Column of the plan's name."""

PREFIX = "setting_"
"""How the columns of its settings begin, after which comes a setting's name with its unit."""

NAME_MAX = 63
"""Characters of a column's name, as MATLAB has them."""

EXACT_MAX = 2**53
"""Whole numbers up to here are numbers; larger ones, which a double has not, are text."""

PlanValue = bool | float | str


def plan_columns(metadata: Mapping[str, Any]) -> dict[str, PlanValue]:
    """Return the columns of a recording's plan by its metadata; none of one without a plan.

    Settings in a table of settings are columns of their own, setting_TABLE_NAME. Numbers are
    float, lists are JSON; a setting that is null has no column.
    """
    plan = metadata.get("plan")
    if isinstance(plan, str):
        plan = {"name": plan}
    if not isinstance(plan, Mapping) or not plan.get("name"):
        return {}
    columns: dict[str, PlanValue] = {PLAN: _value(str(plan["name"]))}
    settings = plan.get("settings")
    for name, value in _flat(settings if isinstance(settings, Mapping) else {}):
        columns[_free(PREFIX + re.sub(r"\W", "_", name, flags=re.ASCII), columns)] = _value(value)
    return columns


def common_columns(plans: list[dict[str, PlanValue]]) -> dict[str, PlanValue]:
    """Return the columns of recordings that are one row together.

    The plans' names are joined by commas; a setting that is not the same in all has no column.
    """
    if not any(plans):
        return {}
    names = dict.fromkeys(str(one[PLAN]) for one in plans if one)
    same = {
        name: value
        for name, value in next(filter(None, plans)).items()
        if all(one.get(name) == value for one in plans)
    }
    return {**same, PLAN: ", ".join(names)}


def as_text(value: PlanValue) -> str:
    """Return a value as a table of text has it; a number reads back as the same number."""
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value).removesuffix(".0") if isinstance(value, float) else value


def _flat(settings: Mapping[Any, Any], within: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{within}{key}_")
        elif value is not None:
            yield f"{within}{key}", value


def _value(value: Any) -> PlanValue:
    if isinstance(value, bool | float):
        return value
    if isinstance(value, int) and abs(value) <= EXACT_MAX:
        return float(value)
    if isinstance(value, str):
        return without_surrogates(value)
    return to_json(value)


def _free(name: str, taken: Mapping[str, Any]) -> str:
    """Return a name that is none of those `taken`, also where capitals do not count."""
    known, number, free = {one.lower() for one in taken}, 1, name[:NAME_MAX]
    while free.lower() in known:
        number += 1
        end = f"_{number}"
        free = name[: NAME_MAX - len(end)] + end
    return free
