"""A stored result as a Parquet file, and back."""

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from motord.recording.plan_columns import PLAN, PREFIX, as_text
from motord.results.error import ResultsError, parquet
from motord.results.stored_result import COLUMNS, StoredResult

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

SCHEMA_VERSION = 1
"""Of the files that are written; those of lower ones are read."""

SCHEMA_KEY = b"motord.results.schema"
RECORDINGS_KEY = b"motord.results.recordings"


class NotAResultError(Exception):
    """A file that is none of the store's; the message says why."""


@dataclass(frozen=True)
class ResultFile:
    """The Parquet file of a result, and by what one of the same analysis or figures is found.

    figures: how many there are. The rest as of `StoredResult`.
    """

    name: str
    content: bytes
    analysis_digest: str
    content_digest: str
    version: str
    figures: int

    @classmethod
    def of(cls, result: StoredResult) -> "ResultFile":
        """Return the file of a result. Raises ResultsError if it has no figures."""
        if not result.figures:
            raise ResultsError(f"{result.experiment} of {result.run}: no figures to store")
        return cls(
            result.file_name,
            encode_result(result),
            result.analysis_digest,
            result.content_digest,
            result.version,
            len(result.figures),
        )


def table_schema() -> "pa.Schema":
    """Return names and types of the columns; `time` is UTC. Raises ResultsError."""
    parquet()
    import pyarrow as pa

    types = {"time": pa.timestamp("us", tz="UTC")}
    types |= dict.fromkeys(("value", "stderr", "low", "high"), pa.float64())
    return pa.schema([pa.field(name, types.get(name, pa.string())) for name in COLUMNS])


def encode_result(result: StoredResult) -> bytes:
    """Return the Parquet file of a result, the same bytes for the same result.

    After the columns of `table_schema` come those of its plan.
    """
    import pyarrow as pa

    rows = [vars(row) for row in result.rows()]
    metadata = {
        SCHEMA_KEY: str(SCHEMA_VERSION),
        RECORDINGS_KEY: json.dumps(sorted(result.recordings)),
    }
    table = pa.Table.from_pylist(rows, schema=table_schema().with_metadata(metadata))
    for name, value in result.plan.items():
        table = table.append_column(name, pa.repeat(value, table.num_rows))
    buffer = io.BytesIO()
    parquet().write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def decode_result(data: bytes) -> "pa.Table":
    """Return the rows of a file: the columns of `table_schema`, then those of its plan, if any.

    Raises NotAResultError.
    """
    import pyarrow as pa

    file, version = _opened(data)
    try:
        table = file.read(use_threads=False).replace_schema_metadata()
        fields = [one for one in table.schema if one.name == PLAN or one.name.startswith(PREFIX)]
        schema = pa.schema([*table_schema(), *fields])
        return table.select(schema.names).cast(schema)
    except (pa.ArrowException, KeyError, OSError, ValueError) as error:
        raise NotAResultError(f"damaged, of schema {version}: {_short(error)}") from None


def one_table(tables: Sequence["pa.Table"]) -> "pa.Table":
    """Return the rows of all tables, null where one has not the column of a plan.

    A setting that is text in some of them is text.
    """
    import pyarrow as pa

    types: dict[str, set[pa.DataType]] = {PLAN: {pa.string()}}
    for schema in {table.schema for table in tables}:
        for field in schema:
            types.setdefault(field.name, set()).add(field.type)
    mixed = {name for name, found in types.items() if len(found) > 1}
    base = pa.schema([*table_schema(), pa.field(PLAN, pa.string())]).empty_table()
    return pa.concat_tables(
        [base, *(_with_text(table, mixed) for table in tables)], promote_options="default"
    )


def _with_text(table: "pa.Table", mixed: set[str]) -> "pa.Table":
    """Return a table with the columns `mixed` as text."""
    import pyarrow as pa

    for name in mixed.intersection(table.column_names):
        place, column = table.schema.get_field_index(name), table.column(name)
        values = column.to_pylist()
        text = [value if value is None else as_text(value) for value in values]
        table = table.set_column(place, name, pa.array(text, pa.string()))
    return table


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
