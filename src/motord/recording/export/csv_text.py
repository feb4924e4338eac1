"""Tables as CSV: numbers as text that reads back as the same numbers."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from motord.recording.export.csv_lines import csv_lines
from motord.recording.export.table import ExportedTable
from motord.recording.plan_columns import as_text
from motord.wire.ticks.blocks import Block

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
