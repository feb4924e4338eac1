"""Tables as Parquet, with units, meanings and metadata."""

from pathlib import Path

import numpy as np

from motord.recording.export.optional_packages import optional
from motord.recording.export.table import ExportedTable
from motord.recording.json_encoding import to_json

ROW_GROUP_ROWS = 1 << 17
"""Rows of a row group."""


def write_parquet(path: Path, table: ExportedTable) -> int:
    """Write a table and return its number of rows. Raises RecordError without pyarrow."""
    arrow = "Parquet", "pyarrow", "parquet", "choose a name that ends with .csv"
    pa, parquet = (optional(module, *arrow) for module in ("pyarrow", "pyarrow.parquet"))
    known = {
        name: {"unit": field.unit, "meaning": field.meaning} for name, field in table.fields.items()
    }
    fields = [
        pa.field(name, pa.from_numpy_dtype(table.dtype[name]), metadata=known.get(name))
        for name in table.names
    ]
    fields += [pa.field(name, pa.scalar(value).type) for name, value in table.plan.items()]
    schema = pa.schema(fields, metadata={"motord": to_json(table.metadata)})
    count = 0
    with (
        path.open("wb") as file,  # pyarrow opens no path that is not UTF-8
        parquet.ParquetWriter(file, schema, compression="zstd") as writer,
    ):
        for group in table.gathered(ROW_GROUP_ROWS):
            columns = [np.ascontiguousarray(group[name]) for name in table.names]
            columns += [pa.repeat(value, len(group)) for value in table.plan.values()]
            writer.write_table(pa.table(columns, schema=schema))
            count += len(group)
    return count
