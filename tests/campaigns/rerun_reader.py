"""Run by an interpreter that has rerun-sdk: what its MCAP loader makes of a recording.

    python rerun_reader.py RUN.mcap OUT.parquet

Writes the fields of every tick as columns, as the loader's chunks have them, and prints for every
topic how many messages the loader found.
"""

import json
import sys

import pyarrow as pa
import pyarrow.parquet as pq
from rerun.chunk import McapReader

MESSAGE = "motord.Tick:message"


def main() -> None:
    run, out = sys.argv[1:]
    counts: dict[str, int] = {}
    tables = []
    for chunk in McapReader(run, recover=True).stream():
        batch = chunk.to_record_batch()
        if "message_log_time" not in batch.schema.names:
            continue  # of the channel, not of its messages
        counts[chunk.entity_path] = counts.get(chunk.entity_path, 0) + batch.num_rows
        if MESSAGE in batch.schema.names:
            fields = batch.column(MESSAGE).flatten()
            columns = dict(zip(fields.type.names, fields.flatten(), strict=True))
            columns["message_log_time"] = batch.column("message_log_time").cast(pa.int64())
            tables.append(pa.table(columns))
    pq.write_table(pa.concat_tables(tables), out)
    print(json.dumps(counts))


if __name__ == "__main__":
    main()
