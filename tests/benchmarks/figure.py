"""A figure of a benchmark: what was measured, and how it compares with its bound."""

import math
from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Figure:
    """A measured value with its unit ("" for a ratio or a number) and the bound it has to keep.

    Without `bound` it is for information. `note` says what it was made of.
    """

    what: str
    value: float
    unit: str = ""
    bound: float | None = None
    side: Literal["at most", "at least"] = "at most"
    note: str = ""

    @property
    def met(self) -> bool | None:
        """True if the bound is kept; None without one, or if there was nothing to measure."""
        if self.bound is None or math.isnan(self.value) or math.isnan(self.bound):
            return None
        return self.value <= self.bound if self.side == "at most" else self.value >= self.bound

    def row(self) -> list[str]:
        """Return what, figure, bound, whether it is met, and the note, for a table."""
        bound = "" if self.bound is None else f"{self.side} {number(self.bound)}"
        met = {True: "met", False: "NOT MET", None: ""}[self.met]
        if self.bound is not None and self.met is None:
            met = "not measured"
        return [self.what, f"{number(self.value)} {self.unit}".strip(), bound, met, self.note]

    def as_json(self) -> dict[str, Any]:
        """Return the figure for a file; null for what is not a number."""
        value = None if math.isnan(self.value) else self.value
        bound = None if self.bound is None or math.isnan(self.bound) else self.bound
        kept = {"what": self.what, "value": value, "unit": self.unit, "bound": bound}
        return {**kept, "side": self.side, "met": self.met, "note": self.note}


def number(value: float) -> str:
    """Return a number with three digits or, if it is whole or large, without a fraction."""
    if math.isnan(value):
        return "-"
    return f"{value:.0f}" if value == round(value) or abs(value) >= 100 else f"{value:.3g}"
