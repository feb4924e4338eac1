"""A stored result as a Parquet file, and back."""

import io
import json
from typing import TYPE_CHECKING, Any

from motord.results.error import parquet
from motord.results.row import COLUMNS
from motord.results.stored_result import StoredResult

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

SCHEMA_VERSION = 1
"""Of the files that are written; those of lower ones are read."""

SCHEMA_KEY = b"motord.results.schema"
RECORDINGS_KEY = b"motord.results.recordings"


class NotAResultError(Exception):
    """A file that is none of the store's; the message says why."""


def table_schema() -> "pa.Schema":
    """Return names and types of the columns; `time` is UTC. Raises ResultsError."""
    parquet()
    import pyarrow as pa

    types = {"time": pa.timestamp("us", tz="UTC")}
    types |= dict.fromkeys(("value", "stderr", "low", "high"), pa.float64())
    return pa.schema([pa.field(name, types.get(name, pa.string())) for name in COLUMNS])


def encode_result(result: StoredResult) -> bytes:
    """Return the Parquet file of a result, the same bytes for the same result."""
    import pyarrow as pa

    rows = [vars(row) for row in result.rows()]
    metadata = {
        SCHEMA_KEY: str(SCHEMA_VERSION),
        RECORDINGS_KEY: json.dumps(sorted(result.recordings)),
    }
    table = pa.Table.from_pylist(rows, schema=table_schema().with_metadata(metadata))
    buffer = io.BytesIO()
    parquet().write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def decode_result(data: bytes) -> "pa.Table":
    """Return the rows of a file, with the columns of `table_schema`. Raises NotAResultError."""
    import pyarrow as pa

    file, version = _opened(data)
    try:
        table = file.read(use_threads=False).select(COLUMNS)
        return table.replace_schema_metadata().cast(table_schema())
    except (pa.ArrowException, KeyError, OSError, ValueError) as error:
        raise NotAResultError(f"damaged, of schema {version}: {_short(error)}") from None


def check_result(data: bytes) -> None:
    """Raise NotAResultError if a file is none of a result, by its end alone."""
    _opened(data)


def _opened(data: bytes) -> tuple["pq.ParquetFile", int]:
    """Return a file and its schema version. Raises NotAResultError, also for a newer version."""
    import pyarrow as pa

    try:
        file = parquet().ParquetFile(pa.BufferReader(data), pre_buffer=False)
        metadata = file.schema_arrow.metadata or {}
    except (pa.ArrowException, OSError, ValueError) as error:
        raise NotAResultError(f"no Parquet file: {_short(error)}") from None
    version = metadata.get(SCHEMA_KEY, b"").decode("ascii", "replace")
    if not version.isdecimal():
        raise NotAResultError("a Parquet file that motord did not write")
    if not 1 <= int(version) <= SCHEMA_VERSION:
        raise NotAResultError(
            f"of schema {version}, this motord reads up to {SCHEMA_VERSION}: update motord"
        )
    return file, int(version)


def _short(error: Any) -> str:
    return str(error).strip().partition("\n")[0] or type(error).__name__
