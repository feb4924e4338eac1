"""Byte patterns: rows of bytes some of which are constant, made and recognised as arrays."""

from collections.abc import Iterable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]

ROWS_AT_ONCE = 512
"""Rows that are compared together, so that what is in between stays in the cache."""


class Pattern:
    """A row of bytes: `template` (size,) and `mask` (size,), 255 where a byte is constant."""

    def __init__(self, template: Bytes, mask: Bytes) -> None:
        self.template = template
        self.mask = mask

    @classmethod
    def fixed(cls, content: bytes) -> "Pattern":
        """Return a pattern of constant bytes."""
        template = np.frombuffer(content, np.uint8)
        return cls(template, np.full_like(template, 0xFF))

    @classmethod
    def free(cls, size: int) -> "Pattern":
        """Return a pattern of `size` bytes that may be anything, zero in the template."""
        return cls(np.zeros(size, np.uint8), np.zeros(size, np.uint8))

    @classmethod
    def joined(cls, parts: Iterable["Pattern"]) -> "Pattern":
        """Return the patterns `parts` one after the other."""
        every = list(parts)
        return cls(
            np.concatenate([part.template for part in every]),
            np.concatenate([part.mask for part in every]),
        )

    def __add__(self, other: "Pattern") -> "Pattern":
        return Pattern.joined([self, other])

    @property
    def size(self) -> int:
        """Bytes in a row."""
        return len(self.template)

    def rows(self, count: int) -> Bytes:
        """Return new rows, shape (count, size), all equal to the template."""
        rows = np.empty((count, self.size), np.uint8)
        rows[:] = self.template
        return rows

    def matching(self, rows: Bytes) -> int:
        """Return how many of `rows` (n, size), from the first on, have the constant bytes."""
        content = np.ascontiguousarray(rows).reshape(-1)
        masks, templates = self._repeated
        for start in range(0, len(content), len(masks)):
            part = content[start : start + len(masks)]
            wrong = (part & masks[: len(part)]) != templates[: len(part)]
            if wrong.any():
                return (start + int(np.argmax(wrong))) // self.size
        return len(rows)

    @cached_property
    def _repeated(self) -> tuple[Bytes, Bytes]:
        """Mask and template of `ROWS_AT_ONCE` rows, one after the other."""
        return np.tile(self.mask, ROWS_AT_ONCE), np.tile(self.template, ROWS_AT_ONCE)
