"""Characters of the screen: Unicode, or ASCII for terminals and locales that have no more."""

import locale
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

from rich.text import Text


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
