"""CSV: numbers as text that reads back as the same numbers, no text a formula to spreadsheets."""

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motord.recording.export.table import ExportedTable
from motord.recording.plan_columns import as_text
from motord.wire.ticks.blocks import Block

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


CSV_ROWS = 1 << 12
"""Rows that are made into text at once."""

_PRINTF = {"f4": "%.9g", "f8": "%.17g"} | dict.fromkeys(("i4", "i8", "u4", "u8"), "%d")
"""Formats by types; with so many digits a number reads back exactly."""


def write_csv(path: Path, table: ExportedTable) -> int:
    """Write a table and return its number of rows."""
    text, count = _csv_text(table.dtype), 0
    end = csv_lines([[*map(as_text, table.plan.values())]]).encode()
    with path.open("wb") as file:
        file.write(csv_lines([[*table.names, *table.plan]]).encode())
        for block in table.gathered(CSV_ROWS):
            rows = text(block)
            file.write(rows.replace(b"\n", b"," + end) if table.plan else rows)
            count += len(block)
    return count


def _csv_text(dtype: np.dtype[np.void]) -> Callable[[Block], bytes]:
    """Return what makes lines of a block: pyarrow, if it is there, or Python at half its speed."""
    try:
        import pyarrow as pa
        from pyarrow import csv as arrow_csv
    except ImportError:
        line = ",".join(_PRINTF[dtype[name].str[1:]] for name in dtype.names or ()) + "\n"
        return lambda block: "".join([line % row for row in block.tolist()]).encode()
    options = arrow_csv.WriteOptions(include_header=False)

    def text(block: Block) -> bytes:
        columns = {name: np.ascontiguousarray(block[name]) for name in dtype.names or ()}
        sink = pa.BufferOutputStream()
        arrow_csv.write_csv(pa.table(columns), sink, options)
        return bytes(sink.getvalue())

    return text
