"""The bench file as parameters of Foxglove: one a value, by its path, as in `limits.torque_Nm`."""

from collections.abc import Iterator, Mapping
from typing import Any

MAX_ITEMS = 64
"""Longer lists, such as a table of the back-EMF, are given by their length alone."""


def flat(tables: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the values in nested tables by dotted path; what is null is left out."""
    return dict(_values(tables, prefix))


def _values(tables: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for key, value in tables.items():
        path = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _values(value, f"{path}.")
        elif isinstance(value, list) and len(value) > MAX_ITEMS:
            yield path, f"{len(value)} values"
        elif value is not None:
            yield path, value
