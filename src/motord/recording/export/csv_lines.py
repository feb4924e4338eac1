"""Rows as CSV in which no text is a formula to a spreadsheet."""

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

FORMULA = ("=", "+", "-", "@", "\t", "\n", "＝", "＋", "－", "＠")
"""How a cell begins that spreadsheets may take for a formula (OWASP, CSV injection)."""


def csv_lines(rows: Iterable[Sequence[Any]]) -> str:
    """Return rows as lines of CSV; an apostrophe before text that begins as a formula does.

    Numbers stay as they are, also those that are text. Lines within a text end with a line feed: a
    carriage return, which the csv module leaves without quotes, would begin a row.
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([_cell(one) for one in row] for row in rows)
    return text.getvalue()


def _cell(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    text = value.replace("\r\n", "\n").replace("\r", "\n")
    try:
        float(text)
    except ValueError:
        return f"'{text}" if text.startswith(FORMULA) else text
    return text
