"""What parts of a bench file share besides `motord.section`: further bounds, one kind of error."""

from typing import Annotated

from pydantic import AfterValidator, Field

from motord.section import Finite as Finite
from motord.section import NonNegative as NonNegative
from motord.section import Positive as Positive
from motord.section import Section as Section
from motord.section import matching as matching
from motord.section.quantities import Temperature, Torque, TurnsPerSecond

CPUS_MAX = 8192
"""The kernel knows no more."""
BitRate = Annotated[int, Field(gt=0, le=100_000_000)]
"""Bit/s of a line; no interface does more."""
Mask = Annotated[int, Field(ge=0, lt=2**64)]
"""Bits of a signal, or a value of it: CAN has no signal of more than 64 bits."""
PlainName = Annotated[
    str,
    matching(
        r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}",
        "letters, digits, _, . and -, at most 64, of which the first is a letter or digit",
    ),
]
"""A name that is part of keys, of file names, or that of an entry point."""
Fraction = Annotated[float, Field(ge=0, le=1)]


def _ordered(band: tuple[float, float]) -> tuple[float, float]:
    if band[0] >= band[1]:
        raise ValueError("the lower temperature comes first")
    return band


TemperatureBand = Annotated[tuple[Temperature, Temperature], AfterValidator(_ordered)]
"""From, to (degC)."""

MAX_VALUES = 64
"""Values of a list in a plan: anybody may ask for a plan, and the supervisor builds it."""

Torques = Annotated[tuple[Torque, ...], Field(min_length=1, max_length=MAX_VALUES)]
Speeds = Annotated[tuple[TurnsPerSecond, ...], Field(min_length=1, max_length=MAX_VALUES)]


class ConfigError(Exception):
    """A bench file that cannot be used; the message says where, what and what to do.

    It has a line for each thing that is wrong.
    """

    @property
    def lines(self) -> list[str]:
        """What is wrong, one by one."""
        return str(self).splitlines()

    def after(self, where: str) -> "ConfigError":
        """Return an error that has `where` before each line."""
        return ConfigError("\n".join(f"{where}{line}" for line in self.lines))
