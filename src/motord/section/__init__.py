"""Strict tables of files and requests: immutable sections, bounded numbers.

Also of what needs nothing else of the bench file: clients load no `motord.config`.
"""

import re
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema

LARGEST, SMALLEST = 1e12, 1e-12
"""Of any quantity, in its unit: products and quotients of two, and single precision, hold them."""


def _not_too_large(value: float) -> float:
    if abs(value) > LARGEST:
        raise ValueError(f"no quantity is beyond {LARGEST:g}")
    return value


def not_too_small(value: float) -> float:
    """Return a value that is 0 or has an inverse. Raises ValueError."""
    if 0 < value < SMALLEST:
        raise ValueError(f"no quantity that is above 0 is below {SMALLEST:g}")
    return value


Finite = Annotated[float, Field(allow_inf_nan=False), AfterValidator(_not_too_large)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False), AfterValidator(_not_too_large)]
Positive = Annotated[
    float,
    Field(gt=0, allow_inf_nan=False),
    AfterValidator(_not_too_large),
    AfterValidator(not_too_small),
]
"""Bounds come before validators: those that come after one are not in the JSON schema, from which
reference and forms are made."""


def matching(pattern: str, what: str) -> AfterValidator:
    """Return the validator of text that matches all of `pattern`; another one is not `what`."""

    def check(value: str) -> str:
        if re.fullmatch(pattern, value) is None:
            raise ValueError(f"takes {what}")
        return value

    return AfterValidator(check)


_SCALARS = ("bool", "float", "int", "str")
_CONTAINERS = (dict, list, tuple)


def _make_scalars_strict(schema: Any) -> None:
    parts = schema
    if isinstance(schema, dict):
        if schema.get("type") in _SCALARS:
            schema["strict"] = True
        parts = schema.values()
    for part in parts:
        if isinstance(part, _CONTAINERS):
            _make_scalars_strict(part)


class Section(BaseModel, extra="forbid", frozen=True, validate_default=True):
    """A table of the bench file: immutable, no unknown keys, no value of another type.

    A whole number may stand for a float; else nothing is converted: no text or bool to a number, no
    float to a whole number, no number to a bool. This holds for every field of every section.
    """

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return the schema with every scalar strict; lists stay good for tuples, text for paths.

        `strict` in the configuration of the model would refuse those, too.
        """
        schema = handler(source)
        _make_scalars_strict(schema)
        return schema


class SensorHighpass:
    """What has the high-pass of a torque sensor."""

    highpass_time_constant_s: float

    @property
    def passes_mean(self) -> bool:
        """False for a sensor, piezoelectric for instance, that cannot measure a steady torque."""
        return self.highpass_time_constant_s == 0.0
