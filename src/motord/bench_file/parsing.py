"""Answers as values of a bench file, judged by the models that will read it."""

import math
from functools import cache
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import TypeAdapter, ValidationError

from motord.bench_file.questions import BACK_EMF, Question
from motord.config import ConfigError
from motord.config.text.descriptions import field_of
from motord.section.complaints import complaints, message
from motord.untrusted import parse_toml


def parse(question: Question, text: str) -> Any:
    """Return an answer as a value of the bench file. Raises ConfigError."""
    if question.key == BACK_EMF:
        return _back_emf(text)
    if question.choices and text not in question.choices:
        raise ConfigError(f"one of {', '.join(question.choices)}, not {text!r}")
    value = text if _takes_text(question.key) else _value(text)
    try:
        strict = field_of(question.key).annotation in (int, float)  # a bool is no number
        checked = _adapter(question.key).validate_python(value, strict=strict)
    except ValidationError as error:
        wrong = (f"{message(one)}, not {text!r}" for one in complaints(error))
        raise ConfigError("\n".join(wrong)) from None
    return value if isinstance(checked, Path) else checked


@cache
def _adapter(key: str) -> TypeAdapter[Any]:
    field = field_of(key)
    kind: Any = Annotated[field.annotation, field]
    return TypeAdapter(kind)


def _takes_text(key: str) -> bool:
    kinds = {field_of(key).annotation, *map(type, get_args(field_of(key).annotation))}
    return bool(kinds & {str, Path})


def _value(text: str) -> Any:
    """Return a number or a bool as TOML has it, anything else as text."""
    try:
        return parse_toml(f"value = {text}")["value"]
    except ValueError:
        return text


def _back_emf(text: str) -> Any:
    """Return one harmonic with this amplitude, or the name of a file with a table."""
    value = _value(text)
    if isinstance(value, int | float) and not isinstance(value, bool):
        if not 0 < value < math.inf:
            raise ConfigError(f"an amplitude above 0, not {text!r}")
        return [{"order": 1, "amplitude_V_s_per_rad": float(value), "phase_rad": 0.0}]
    if not text:
        raise ConfigError("a number, or a file that `motord analyse back-emf -o` wrote")
    return text
