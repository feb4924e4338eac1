"""Findings: where data depart from the model of a result, and what that usually means."""

from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

Severity = Literal["note", "warning", "serious"]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Finding:
    """Something that the stated intervals of a result do not account for.

    `value` is beyond `limit`, both in `unit`; `meaning` is what usually causes it, `action` what to
    do. severity: a `serious` one makes the result's intervals too narrow.
    """

    name: str
    value: Annotated[float, Field(allow_inf_nan=False)]
    limit: Annotated[float, Field(allow_inf_nan=False)]
    unit: str
    severity: Severity
    meaning: str
    action: str

    def size(self) -> str:
        """Return value and limit."""
        unit = self.unit
        counted = unit.replace(" ", "").isalpha() and len(unit) > 3 and " of " not in unit
        if self.value == 1 and counted:
            unit = _singular(unit)
        return f"{self.value:.3g} {unit} (limit {self.limit:.3g})"

    def figure(self) -> str:
        """Return name, value and limit."""
        return f"{self.name}, {self.size()}"

    def to_text(self) -> str:
        """Return the finding as one line of text."""
        return f"{self.severity}: {self.figure()}: {self.meaning}; {self.action}"


def _singular(unit: str) -> str:
    if unit.endswith("ies"):
        return f"{unit[:-3]}y"
    return unit.removesuffix("s")


def listed(texts: Sequence[str], most: int = 4, between: str = "; ") -> str:
    """Return texts, each once with how many times, as one; of many the first, and how many more."""
    named = [f"{text} ({n} times)" if n > 1 else text for text, n in Counter(texts).items()]
    more = f" and {len(named) - most} more" if len(named) > most else ""
    return between.join(named[:most]) + more
