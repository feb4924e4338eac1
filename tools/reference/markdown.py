"""Tables and headings of Markdown."""

import re
from collections.abc import Iterable, Sequence

NOTE = "<!-- Made by `make reference` from {source}. Do not edit. -->"


def page(title: str, source: str, *parts: str) -> str:
    """Return a page of these parts, with a note that it is made."""
    return "\n\n".join([NOTE.format(source=source), f"# {title}", *filter(None, parts)]) + "\n"


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; bars in cells are escaped."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(_cell(cell) for cell in line) + " |" for line in lines)


def _cell(text: str) -> str:
    return re.sub(r"[ \n]+", " ", text).strip().replace("|", "\\|")


def code(text: object) -> str:
    """Return text set as code; nothing stays nothing."""
    return f"`{text}`" if str(text) else ""
