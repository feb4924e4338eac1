"""Values of Python and numpy as JSON that every reader takes: no NaN, no numpy, no paths."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from motord.untrusted import parse_json

JSON_KEYS = "json_keys"
"""Key of a metadata record that lists, with commas, the keys whose values are JSON."""


def plain(value: object) -> Any:
    """Return `value` made of dict, list, str, int, finite float, bool and None (for nan, inf)."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)


def to_json(value: object) -> str:
    """Return `value` as JSON on one line; what JSON does not know becomes null or a string."""
    return json.dumps(plain(value), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def to_line(value: object) -> bytes:
    """Return `value` as one line of JSON in UTF-8, without its end.

    Half a surrogate pair, as a name of a file may have, becomes a question mark.
    """
    return to_json(value).encode(errors="replace")


def to_strings(values: Mapping[str, object]) -> dict[str, str]:
    """Return the strings of a metadata record: text as it is, anything else as JSON."""
    strings = {key: v if isinstance(v, str) else to_json(v) for key, v in values.items()}
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
