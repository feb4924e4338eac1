"""What every part of a bench file shares: strict sections, bounded numbers, one kind of error."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]


def _ordered(band: tuple[float, float]) -> tuple[float, float]:
    if band[0] >= band[1]:
        raise ValueError("the lower temperature comes first")
    return band


TemperatureBand = Annotated[tuple[Finite, Finite], AfterValidator(_ordered)]
"""From, to (degC)."""


class ConfigError(Exception):
    """A bench file that cannot be used; the message says where, what and what to do."""


class Section(BaseModel):
    """A table of the bench file: immutable, no unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)
