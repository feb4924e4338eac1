"""Tables as ASAM MDF 4.1, one channel group with a master channel of seconds."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from motord.recording.errors import RecordError
from motord.recording.export.optional_packages import optional
from motord.recording.export.table import TIME, ExportedTable
from motord.recording.json_encoding import to_json
from motord.wire.ticks.blocks import Block

GROUP_ROWS = 1 << 17
"""Rows that are added at once."""


def write_mdf(path: Path, table: ExportedTable) -> int:
    """Write a table and return its number of rows. Raises RecordError without asammdf or `t_ns`.

    The file starts at the first row; the master channel counts seconds from there, and t_ns is a
    channel as well. The metadata, the plan's settings among them, are the header's text, as JSON.
    """
    asammdf = optional("asammdf", "MDF", "asammdf", "mdf", "choose a name that ends with .csv")
    if TIME not in table.names:
        raise RecordError(f"MDF needs the time of each row: let --columns have {TIME}")
    fields, start_ns, count = table.fields, 0, 0
    with asammdf.MDF(version="4.10") as mdf:
        mdf.header.description = to_json(table.metadata)
        for rows in table.gathered(GROUP_ROWS):
            if count == 0:
                start_ns = int(rows[TIME][0])
                mdf.start_time = datetime.fromtimestamp(start_ns // 1000 / 1e6, UTC)
                time_s = _since(rows, start_ns)
                signals = [
                    asammdf.Signal(
                        np.ascontiguousarray(rows[name]),
                        time_s,
                        name=name,
                        unit=fields[name].unit if name in fields else "",
                        comment=fields[name].meaning if name in fields else "",
                    )
                    for name in table.names
                ]
                mdf.append(signals, comment=table.record.name, common_timebase=True)
            else:
                columns = [np.ascontiguousarray(rows[name]) for name in table.names]
                mdf.extend(0, [(one, None) for one in (_since(rows, start_ns), *columns)])
            count += len(rows)
        with path.open("w+b") as file:
            mdf.save(file)
    return count


def _since(rows: Block, start_ns: int) -> np.ndarray:
    return np.asarray((rows[TIME] - start_ns) * 1e-9)
