"""Tables as MATLAB files: a struct of columns, with structs of their units and meanings."""

from pathlib import Path

import numpy as np
from scipy.io import savemat

from motord.recording.errors import RecordError
from motord.recording.export.table import ExportedTable
from motord.recording.json_encoding import to_json
from motord.schema import joined

BYTES_MAX = 2**31 - 2**20
"""What a variable of a file of MATLAB 5 can hold, less what surrounds the columns."""


def write_matlab(path: Path, table: ExportedTable) -> int:
    """Write a table as a file of MATLAB 5 and return its number of rows.

    Variables: motord.ticks.NAME (rows, 1), motord.units.NAME, motord.meanings.NAME,
    motord.metadata, which is JSON, and motord.plan.NAME, once, not in each row. Raises RecordError
    for more than such a file can hold.
    """
    blocks, size = [np.empty(0, table.dtype)], 0
    for block in table.blocks:
        size += len(block) * sum(table.dtype[name].itemsize for name in table.names)
        if size > BYTES_MAX:
            raise RecordError(
                f"{path.name.removesuffix('.part')}: a .mat file holds at most 2 GiB: choose fewer "
                "columns (--columns), or a name that ends with .parquet"
            )
        blocks.append(block)
    rows = joined(blocks)
    content = {
        "ticks": {name: np.ascontiguousarray(rows[name])[:, None] for name in table.names},
        "units": {name: field.unit for name, field in table.fields.items()},
        "meanings": {name: field.meaning for name, field in table.fields.items()},
        "metadata": to_json(table.metadata),
        **({"plan": table.plan} if table.plan else {}),
    }
    with path.open("wb") as file:
        savemat(file, {"motord": content}, do_compression=True, long_field_names=True)
    return len(rows)
