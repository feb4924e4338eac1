"""Names of the elements of lists in a result, which do not depend on what else is in the list."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from motord.config.unit_suffixes import UNITS, split_unit

OF_PHASES = (
    "alpha", "beta", "alpha_induced", "beta_induced", "current_gain", "offset", "noise",
)  # fmt: skip
"""Quantities of phases a, b, c, without their units."""

IDENTITIES = (
    ("torque_Nm", "speed_Hz", "compensate"),
    ("torque_Nm", "speed_Hz"),
    ("speed_set_Hz", "direction"),
    *(("order",), ("name",), ("label",), ("source",), ("quantity",), ("what",)),
    *(("direction",), ("index",)),
)
"""Keys by which an element is known; the first that all elements have are taken."""

NUMBERED_MAX = 16
"""Numbers of a list that are figures of their own; a longer one is a table."""


def label_elements(
    elements: Sequence[Mapping[str, Any]],
) -> Iterator[tuple[str, Mapping[str, Any], tuple[str, ...]]]:
    """Yield name, element, and the keys that the name is of; without any a number from 1 on.

    The second of a name is name#2.
    """
    keys = next((keys for keys in IDENTITIES if all(_has(one, keys) for one in elements)), ())
    seen: Counter[str] = Counter()
    for number, element in enumerate(elements, 1):
        name = ",".join(_label(key, element[key], len(keys)) for key in keys) or str(number)
        seen[name] += 1
        yield name if seen[name] == 1 else f"{name}#{seen[name]}", element, keys


def number_elements(key: str, values: Any) -> Iterator[tuple[int, str]]:
    """Yield place and name of each number of a short list: phases by letter, others from 1 on."""
    if not isinstance(values, Sequence) or isinstance(values, str) or len(values) > NUMBERED_MAX:
        return
    phases = len(values) == 3 and split_unit(key)[0] in OF_PHASES
    for place in range(len(values)):
        yield place, "abc"[place] if phases else str(place + 1)


def _has(element: Mapping[str, Any], keys: Sequence[str]) -> bool:
    return all(isinstance(element.get(key), str | int | float) for key in keys)


def _label(key: str, value: Any, keys: int) -> str:
    """Return a part of a name: 3Nm, compensate=1; alone just the value."""
    text = value if isinstance(value, str) else f"{value:g}"
    if isinstance(value, str) or keys == 1:
        return text
    unit = UNITS.get(split_unit(key)[1], "")
    return f"{text}{unit}" if unit else f"{key}={text}"
