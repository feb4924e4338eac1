"""Characters of the screen, and sparklines: Unicode, or ASCII where there is no more."""

import locale
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from rich.text import Text

_DOTS = np.array([[0x40, 0x04, 0x02, 0x01], [0x80, 0x20, 0x10, 0x08]])
"""Bit of a Braille pattern by column and level, the lowest level first."""
_PATTERNS, _DOT_LEVELS = 0x2800, 4
_ASCII = (" ", ".", "-", ":", "'", ":", ":", "|")
"""Character by the levels that are in it: 1 low, 2 middle, 4 high."""
_ASCII_LEVELS = 3


@dataclass(frozen=True)
class Glyphs:
    """What the screen is drawn with; each is one cell wide but those of `state`."""

    braille: bool
    rule: str
    ellipsis: str
    bar: tuple[str, str]  # done, to do
    state: Mapping[str, str]

    def cut(self, line: Text, width: int) -> None:
        """Cut a line to `width` cells, with a mark at its end: a figure never looks whole."""
        if line.cell_len > width:
            line.rstrip()
        if line.cell_len > width:
            line.truncate(max(width - 1, 0))
            line.append(self.ellipsis[:width])


UNICODE = Glyphs(
    braille=True,
    rule="─",
    ellipsis="…",
    bar=("█", "░"),
    state={"OFF": "○", "READY": "◐", "ENABLED": "●", "TRIPPED": "✕"},
)
ASCII = Glyphs(
    braille=False,
    rule="-",
    ellipsis="~",
    bar=("#", "."),
    state={"OFF": "( )", "READY": "(-)", "ENABLED": "(*)", "TRIPPED": "(X)"},
)

_FEW_CHARACTERS = frozenset({"linux", "vt100", "vt102", "vt220", "ansi", "cons25"})
"""Terminals whose fonts have no Braille patterns."""


def suitable(environment: Mapping[str, str] = os.environ, codeset: str | None = None) -> Glyphs:
    """Return what the terminal can show, by TERM and the codeset of the locale."""
    if codeset is None:
        with suppress(locale.Error):  # LANG or LC_* names one that this computer does not have
            locale.setlocale(locale.LC_CTYPE, "")
        codeset = locale.nl_langinfo(locale.CODESET)
    if environment.get("TERM") in _FEW_CHARACTERS or codeset.lower() not in ("utf-8", "utf8"):
        return ASCII
    return UNICODE


def columns_per_character(braille: bool) -> int:
    """Return how many columns of values a character shows."""
    return 2 if braille else 1


def sparkline(
    low: np.ndarray, high: np.ndarray, limits: tuple[float, float], rows: int, *, braille: bool
) -> list[str]:
    """Return `rows` lines of text, the upper one first, of columns that reach from low to high.

    `low` and `high` have shape (n,), NaN for a column without values; `limits` are the values at
    the lower and the upper edge.
    """
    levels = rows * (_DOT_LEVELS if braille else _ASCII_LEVELS)
    filled = _filled(low, high, limits, levels)
    if not braille:
        bits = filled.reshape(len(low), rows, _ASCII_LEVELS) @ np.array([1, 2, 4])
        return ["".join(_ASCII[bit] for bit in bits[:, row]) for row in reversed(range(rows))]
    if len(low) % 2:  # the newest stays at the right edge
        filled = np.concatenate([np.zeros((1, levels), bool), filled])
    cells = filled.reshape(-1, 2, rows, _DOT_LEVELS)
    codes = _PATTERNS + np.einsum("xcrl,cl->xr", cells.astype(int), _DOTS)
    texts = ("".join(map(chr, codes[:, row])) for row in reversed(range(rows)))
    return [text.replace(chr(_PATTERNS), " ") for text in texts]


def _filled(
    low: np.ndarray, high: np.ndarray, limits: tuple[float, float], levels: int
) -> np.ndarray:
    """Return which levels each column reaches over, shape (n, levels), the lowest first."""
    bottom, top = limits
    scale = levels / (top - bottom) if top > bottom else 0.0
    known = np.isfinite(low) & np.isfinite(high)
    first, last = (
        np.clip(np.floor((np.where(known, edge, bottom) - bottom) * scale), 0, levels - 1)
        for edge in (low, high)
    )
    level = np.arange(levels)
    inside = (level >= first[:, None]) & (level <= last[:, None])
    return np.asarray(inside & known[:, None])


def axis_limits(low: np.ndarray, high: np.ndarray, floor: float) -> tuple[float, float]:
    """Return the edges for a sparkline: all values and zero are in it, and at least +- `floor`.

    A side that no value is on has no floor, so the noise of a bench at rest stays small.
    """
    finite_low, finite_high = low[np.isfinite(low)], high[np.isfinite(high)]
    least = float(finite_low.min()) if len(finite_low) else 0.0
    most = float(finite_high.max()) if len(finite_high) else 0.0
    bottom, top = min(least, 0.0), max(most, 0.0)
    if top - bottom >= floor:
        return bottom, top
    return (-floor, top) if -bottom > top else (bottom, floor)
