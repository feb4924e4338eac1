"""Values of JSON against the part of JSON Schema that the topics of a recording use.

A recording may be from another program, or changed by one: what it says in JSON is checked once,
where it is read, and everything behind that may rely on types and on what is required.
"""

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any

JsonSchema = Mapping[str, Any]
"""`type`, `properties`, `required`, `items` and `additionalProperties` of a JSON Schema."""


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


_TYPES: dict[str, Callable[[Any], bool]] = {
    "integer": lambda value: _is_number(value) and value == int(value) and abs(value) < 1 << 63,
    "number": lambda value: _is_number(value) and abs(value) < 1e300,
    "string": lambda value: isinstance(value, str),
    "boolean": lambda value: isinstance(value, bool),
    "object": lambda value: isinstance(value, dict),
    "array": lambda value: isinstance(value, list),
}


def misfit(value: object, schema: JsonSchema, name: str = "") -> str:
    """Return what about a value is not as its schema says, "" for nothing; name: of the value.

    A number that is not required may be null: it is not known.
    """
    kind = schema.get("type")
    if kind is not None and not _TYPES[kind](value):
        return f"{name or 'it'} is {_short(value)}: type {kind} is needed"
    parts: list[tuple[str, object, JsonSchema]] = []
    if isinstance(value, dict):
        known: JsonSchema = schema.get("properties", {})
        missing = [key for key in schema.get("required", ()) if value.get(key) is None]
        if missing:
            return f"{name or 'it'} has no {', '.join(missing)}"
        other: JsonSchema = schema.get("additionalProperties", {})
        parts = [(key, one, known.get(key, other)) for key, one in value.items()]
    elif isinstance(value, list):
        parts = [(str(n), one, schema.get("items", {})) for n, one in enumerate(value)]
    for key, one, part in parts:
        unknown = one is None and part.get("type") == "number"
        if not unknown and (wrong := misfit(one, part, f"{name}.{key}" if name else key)):
            return wrong
    return ""


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:36]} ..."
