"""Byte patterns: rows of bytes some of which are constant, made and recognised as arrays."""

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]

ROWS_AT_ONCE = 2048
"""Rows that are compared together, so that they are still in the cache the second time."""

_ROWS_FOLDED = 8


class Pattern:
    """A row of `size` bytes: `template` (size,) and `mask` (size,), 255 where one is constant."""

    def __init__(self, *parts: bytes | int) -> None:
        """Join `parts`: constant bytes, and numbers of bytes that may be anything."""
        known = [part if isinstance(part, bytes) else bytes(part) for part in parts]
        masks = [b"\xff" * len(part) if isinstance(part, bytes) else bytes(part) for part in parts]
        self.template = np.frombuffer(b"".join(known), np.uint8)
        self.mask = np.frombuffer(b"".join(masks), np.uint8)
        self.size = len(self.template)

    def rows(self, count: int) -> Bytes:
        """Return new rows, shape (count, size), all equal to the template."""
        rows = np.empty((count, self.size), np.uint8)
        rows[:] = self.template
        return rows

    def matching(self, rows: Bytes) -> int:
        """Return how many of `rows` (n, size), from the first on, have the constant bytes."""
        for start in range(0, len(rows), ROWS_AT_ONCE):
            part = rows[start : start + ROWS_AT_ONCE]
            together = len(part) - len(part) % _ROWS_FOLDED
            if together and self._all_match(part[:together]):
                part, start = part[together:], start + together
            wrong = (part & self.mask) != self.template
            if wrong.any():
                return start + int(np.argmax(wrong.any(axis=1)))
        return len(rows)

    def _all_match(self, rows: Bytes) -> bool:
        """Return whether all rows, a multiple of `_ROWS_FOLDED`, match.

        A byte is the same in all rows if their conjunction and their disjunction have it. Several
        rows are folded as one long one, which saves numpy a loop for each.
        """
        folded = np.ascontiguousarray(rows).reshape(-1, _ROWS_FOLDED * self.size)
        for found in (np.bitwise_or.reduce(folded), np.bitwise_and.reduce(folded)):
            wrong = (found.reshape(_ROWS_FOLDED, self.size) & self.mask) != self.template
            if wrong.any():
                return False
        return True
