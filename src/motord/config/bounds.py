"""Bounds that values of a bench file are compared with, and that messages name."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

_ROUNDING = 1e-9


@dataclass(frozen=True)
class SettingBound:
    """What a bench file lets its value `name` be: at least `bound` (> 0), at most or less.

    A refusal names the bound: a whole number as it is, any other rounded to three digits within the
    bound. It proposes that value, unless the setting may not be above `greatest` and the bound is,
    and `remedy`.
    """

    name: str
    given: float
    relation: Literal["at least", "at most", "less than"]
    bound: float
    violation: str
    why: str
    remedy: str = ""
    greatest: float = math.inf

    def refusal(self) -> Iterator[str]:
        """Yield why the value is refused and what helps, if it is beyond its bound."""
        beyond, rounded = {
            "at least": (is_below(self.given, self.bound), rounded_up),
            "at most": (is_below(self.bound, self.given), rounded_down),
            "less than": (not is_below(self.given, self.bound), rounded_down),
        }[self.relation]
        if beyond:
            bound = self.bound if isinstance(self.bound, int) else rounded(self.bound)
            taken = [f"make it {self.relation} {bound:g}"] if bound <= self.greatest else []
            remedy = ", or ".join([*taken, *([self.remedy] if self.remedy else [])])
            remedy = remedy or f"no value that it takes is {self.relation} {bound:g}"
            given = f"{self.given:g}" if f"{self.given:g}" != f"{bound:g}" else repr(self.given)
            yield f"{self.name} = {given} is {self.violation}: {self.why}; {remedy}"


def is_below(given: float, least: float) -> bool:
    """Return whether a value is below its bound, by more than decimal fractions are rounded."""
    return given < (1.0 - _ROUNDING) * least


def rounded_up(least: float) -> float:
    """Return a bound > 0 in three digits that is not below it."""
    step = 10.0 ** (math.floor(math.log10(least)) - 2)
    return math.ceil(least / step * (1.0 - _ROUNDING)) * step


def rounded_down(most: float) -> float:
    """Return a bound > 0 in three digits that is not above it."""
    step = 10.0 ** (math.floor(math.log10(most)) - 2)
    return math.floor(most / step * (1.0 + _ROUNDING)) * step
