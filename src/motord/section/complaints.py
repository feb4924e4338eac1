"""What pydantic finds wrong: each mistake once, with the keys as they are written."""

import reprlib
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

Place = tuple[int | str, ...]
"""Keys, numbers of a list, and names of types where there is a choice of them."""

_OTHER_KIND = ("model_type", "model_attributes_type", "dict_type", "tuple_type", "list_type")
_CHOICES = ("tuple[", "list[", "dict[")
_SCALARS = ("bool", "float", "int", "str")


def complaints(error: ValidationError) -> list[ErrorDetails]:
    """Return each thing that is wrong, without those that follow from others.

    Of a value that may be of several types only complaints about the type that it clearly is, if it
    is. A list whose elements are wrong is not too short.
    """
    items: list[ErrorDetails] = [
        item for item in error.errors(include_url=False) if not _left_empty(item)
    ]
    kept = [item for item in items if not _of_another_type(item["loc"], items)]
    return [_without_scalar(item, kept) for item in kept]


def is_type(part: int | str) -> bool:
    """Return whether a part of a place is pydantic's own name of a type."""
    named = isinstance(part, str) and (part[:1].isupper() or part == "[key]")
    return named or str(part).startswith(_CHOICES)


def message(item: ErrorDetails) -> str:
    """Return what is wrong, without place and value."""
    if item["type"] in ("too_short", "too_long"):
        bound = item["ctx"]["min_length" if item["type"] == "too_short" else "max_length"]
        which = "at least" if item["type"] == "too_short" else "at most"
        values = "one value" if bound == 1 else f"{bound} values"
        found = item["ctx"]["actual_length"]  # None: pydantic ends counting
        return f"takes {which} {values}, got {'more' if found is None else found or 'none'}"
    if item["type"] == "path_type":
        return "takes the name of a file"
    return item["msg"].removeprefix("Value error, ")


def dotted(keys: Sequence[int | str]) -> str:
    """Return keys as text: `motor.back_emf[1].order`."""
    text = ""
    for key in map(str, keys):
        text += f"[{key}]" if key.isdigit() else f".{key}" if text else key
    return text


def wrong_things(error: ValidationError) -> Iterator[str]:
    """Yield each thing that is wrong as `place: message`, or as a message if it is of the whole."""
    for item in complaints(error):
        unknown = item["type"] == "extra_forbidden"
        place = dotted([part for part in item["loc"] if not str(part).startswith(_CHOICES)])
        text = "is not known" if unknown else message(item)
        if not unknown and isinstance(item["input"], bool | int | float | str | list):
            text += f", got {reprlib.repr(item['input'])}"
        yield f"{place}: {text}" if place else text


def wrong_setting(error: ValidationError, known: Sequence[str]) -> str:
    """Return what is wrong with a setting; which there are, if it is none of them."""
    first = complaints(error)[0]
    which = ""
    if first["type"] == "extra_forbidden":
        which = f"; settings are: {', '.join(known)}{suggestion(str(first['loc'][-1]), known)}"
    return f"setting {next(wrong_things(error))}{which}"


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return which of the known names may be meant, as the end of a message; "" if none is near."""
    near = get_close_matches(name, known, 1, 0.5)
    return f"; did you mean {near[0]}?" if near else ""


def _left_empty(item: ErrorDetails) -> bool:
    """Return whether a list is too short only for elements that are wrong themselves."""
    given: Any = item["input"]
    return item["type"] == "too_short" and len(given) >= item["ctx"]["min_length"]


def _of_another_type(place: Place, items: Sequence[ErrorDetails]) -> bool:
    """Return whether a complaint is about a type that the value is not, while it is another one."""
    for depth, part in enumerate(place):
        if not is_type(part) or not _misfits(place[: depth + 1], items):
            continue
        types = {
            one["loc"][: depth + 1]
            for one in items
            if one["loc"][:depth] == place[:depth] and is_type((*one["loc"][depth:], "")[0])
        }
        if any(not _misfits(one, items) for one in types):
            return True
    return False


def _misfits(place: Place, items: Sequence[ErrorDetails]) -> bool:
    """Return whether a value is not of the type at the end of `place`: by kind, or by its keys."""
    return any(
        (one["loc"] == place and one["type"] in _OTHER_KIND)
        or (one["loc"][:-1] == place and one["type"] == "extra_forbidden")
        for one in items
    )


def _without_scalar(item: ErrorDetails, items: Sequence[ErrorDetails]) -> ErrorDetails:
    """Return a complaint without the name of a plain type, where there is a choice of them."""
    *place, last = item["loc"] or ("",)
    others = {one["loc"][-1] for one in items if one["loc"] and [*one["loc"][:-1]] == place}
    if last in _SCALARS and len(others & {*_SCALARS}) > 1 and item["type"] != "extra_forbidden":
        return {**item, "loc": tuple(place)}
    return item
