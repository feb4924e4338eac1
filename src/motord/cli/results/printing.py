"""Rows of values as aligned text, CSV or JSON."""

import json
from collections.abc import Iterator, Sequence
from typing import Any

DIGITS = 6
"""Significant digits of numbers in text; CSV and JSON have all of them."""


def aligned(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> Iterator[str]:
    """Yield the lines of a table, numbers to the right, without any limit of the width."""
    texts = [[_text(value) for value in row] for row in rows]
    numbers = [any(isinstance(row[at], int | float) for row in rows) for at in range(len(columns))]
    widths = [max(map(len, column)) for column in zip(columns, *texts, strict=True)]
    for cells in (columns, ["-" * width for width in widths], *texts):
        placed = zip(cells, widths, numbers, strict=True)
        padded = (
            cell.rjust(width) if right else cell.ljust(width) for cell, width, right in placed
        )
        yield "  ".join(padded).rstrip()


def as_csv(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return the rows as CSV with a heading, without the last line's end."""
    from motord.recording.export.csv_text import csv_lines
    from motord.recording.json_encoding import plain

    cells = ([v if isinstance(v, float) else _flat(plain(v)) for v in row] for row in rows)
    return csv_lines([columns, *cells]).removesuffix("\n")


def as_objects(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> list[dict[str, Any]]:
    """Return the rows for JSON, one object each; of columns of one name the last counts."""
    from motord.recording.json_encoding import plain

    return [dict(zip(columns, map(plain, row), strict=True)) for row in rows]


def _text(value: Any) -> str:
    from motord.recording.json_encoding import plain

    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}"
    text = str(_flat(plain(value)))
    return text if text.isprintable() else json.dumps(text, ensure_ascii=False)


def _flat(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, dict | list) else value
