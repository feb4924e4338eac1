"""JSON of recordings: what every reader takes, and what of others is taken.

Written are values of Python and numpy without NaN, numpy and paths. A recording may be from another
program, or changed by one: what it says in JSON is checked once, where it is read, against the part
of JSON Schema that the topics use; everything behind that may rely on types and what is required.
"""

import json
import math
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

import numpy as np

from motord.untrusted import parse_json

JSON_KEYS = "json_keys"
"""Key of a metadata record that lists, with commas, the keys whose values are JSON."""


def plain(value: object) -> Any:
    """Return `value` made of dict, list, str, int, finite float, bool and None (for nan, inf).

    Times as ISO 8601, those without a zone as UTC.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, datetime):
        return value.isoformat() + ("" if value.tzinfo else "Z")
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)


def to_json(value: object) -> str:
    """Return `value` as JSON on one line; what JSON does not know becomes null or a string."""
    return without_surrogates(
        json.dumps(plain(value), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    )


def to_line(value: object) -> bytes:
    """Return `value` as one line of JSON in UTF-8, without its end."""
    return to_json(value).encode()


def without_surrogates(text: str) -> str:
    """Return a text that UTF-8 has: surrogates, as of a file's name, become question marks."""
    return text.encode(errors="replace").decode()


def to_strings(values: Mapping[str, object]) -> dict[str, str]:
    """Return the strings of a metadata record: text as it is, anything else as JSON."""
    strings = {
        key: without_surrogates(v) if isinstance(v, str) else to_json(v)
        for key, v in values.items()
    }
    encoded = [key for key, v in values.items() if not isinstance(v, str)]
    return {**strings, JSON_KEYS: ",".join(encoded)} if encoded else strings


def from_strings(strings: Mapping[str, str]) -> dict[str, Any]:
    """Return the values of a metadata record made by `to_strings`. Raises ValueError."""
    encoded = set(filter(None, strings.get(JSON_KEYS, "").split(",")))
    return {
        key: parse_json(text) if key in encoded else text
        for key, text in strings.items()
        if key != JSON_KEYS
    }


def repaired(strings: Mapping[str, str]) -> dict[str, str]:
    """Return the strings of a metadata record with what is not JSON any more as plain text."""
    claimed = strings.get(JSON_KEYS, "").split(",")
    good = [key for key in claimed if key in strings and _is_json(strings[key])]
    kept = {key: text for key, text in strings.items() if key != JSON_KEYS}
    return {**kept, JSON_KEYS: ",".join(good)} if good else kept


def _is_json(text: str) -> bool:
    try:
        parse_json(text)
    except ValueError:
        return False
    return True


JsonSchema = Mapping[str, Any]
"""`type`, `properties`, `required`, `items` and `additionalProperties` of a JSON Schema."""


def _is_number(value: object) -> bool:
    """Return whether JSON's number is one that a double can hold, its powers included."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


_TYPES: dict[str, Callable[[Any], bool]] = {
    "integer": lambda value: _is_number(value) and value == int(value) and abs(value) < 1 << 63,
    "number": _is_number,
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
