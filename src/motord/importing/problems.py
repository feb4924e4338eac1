"""What is wrong with single rows, by kind: how many, and the lines of the first few."""

from collections.abc import Iterator
from typing import Any

import numpy as np

LINES_NAMED = 5
"""Lines that are named of each kind."""

LEFT_OUT = ": left out"
"""How a kind ends of which the rows are not used."""


class Problems:
    """Counts what is wrong, by kind; `unit` is what a row's number counts: line or row."""

    def __init__(self, unit: str) -> None:
        self.unit = unit
        self._lines: dict[str, list[int]] = {}
        self._counts: dict[str, int] = {}

    def add(self, kind: str, lines: np.ndarray) -> None:
        """Note that rows `lines` (n,) are of this kind, which says what becomes of them."""
        if lines.size:
            named = self._lines.setdefault(kind, [])
            named += lines[: LINES_NAMED - len(named)].tolist()
            self._counts[kind] = self._counts.get(kind, 0) + lines.size

    def __bool__(self) -> bool:
        return bool(self._counts)

    def count(self, kind: str) -> int:
        """Return how many rows are of this kind."""
        return self._counts.get(kind, 0)

    @property
    def left_out(self) -> int:
        """How many rows are not used."""
        return sum(n for kind, n in self._counts.items() if kind.endswith(LEFT_OUT))

    def messages(self) -> Iterator[str]:
        """Yield each kind on a line."""
        for kind, count in self._counts.items():
            named = self._lines[kind]
            more = f" and {count - len(named)} more" if count > len(named) else ""
            plural = self.unit if count == 1 else self.unit + "s"
            yield f"{plural} {', '.join(map(str, named))}{more}: {kind}"

    def to_json(self) -> list[dict[str, Any]]:
        """Return kinds with counts and first lines."""
        return [
            {"what": kind, "count": count, f"first_{self.unit}s": self._lines[kind]}
            for kind, count in self._counts.items()
        ]
