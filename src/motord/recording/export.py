"""Ticks of a recording as CSV or Parquet, written block by block."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from motord.recording.errors import RecordError
from motord.recording.file_names import part_of, require_free
from motord.recording.json_encoding import to_json
from motord.recording.reader import Run
from motord.schema import TICK, TRUTH, Record
from motord.wire.ticks.blocks import Block

ROW_GROUP_ROWS = 1 << 17
"""Rows of a row group of a Parquet file."""


CSV_ROWS = 1 << 12
"""Rows of a CSV file that are made into text at once."""

_PRINTF = {"f4": "%.9g", "f8": "%.17g"} | dict.fromkeys(("i4", "i8", "u4", "u8"), "%d")
"""Formats by types; with so many digits a number reads back exactly."""


def export(
    run: Run, output: Path, columns: Iterable[str] | None = None, *, truth: bool = False
) -> int:
    """Write the ticks of `run` (or the truth of a simulated rig) and return how many.

    The name of `output` ends with .csv or .parquet and chooses the format. Raises RecordError if
    it exists or cannot be written, and for columns that the recording does not have.
    """
    table, record = (run.truth_table, TRUTH) if truth else (run.tick_table, TICK)
    if output.suffix not in (".csv", ".parquet"):
        raise RecordError(f"{output}: its name must end with .csv or .parquet")
    wanted = None if columns is None else tuple(columns)
    dtype, blocks = table.dtype(wanted), table.blocks(wanted)
    with _complete_or_absent(output) as part:
        if output.suffix == ".csv":
            return _write_csv(part, dtype, blocks)
        return _write_parquet(part, dtype, blocks, record, run.metadata)


@contextmanager
def _complete_or_absent(output: Path) -> Iterator[Path]:
    """Give another name to write to, which becomes `output` when the body has succeeded."""
    require_free(output)
    part = part_of(output)
    try:
        yield part
        part.rename(output)
    except OSError as error:
        raise RecordError(f"{output}: cannot write it: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)


def _write_csv(path: Path, dtype: np.dtype[np.void], blocks: Iterator[Block]) -> int:
    """Write numbers as text that reads back as the same numbers."""
    text, count = _csv_text(dtype), 0
    with path.open("wb") as file:
        file.write((",".join(dtype.names or ()) + "\n").encode())
        for block in _gathered(blocks, CSV_ROWS):
            file.write(text(block))
            count += len(block)
    return count


def _csv_text(dtype: np.dtype[np.void]) -> Callable[[Block], bytes]:
    """Return what makes lines of a block: pyarrow, if it is there, or Python at half its speed."""
    try:
        import pyarrow as pa
        from pyarrow import csv
    except ImportError:
        line = ",".join(_PRINTF[dtype[name].str[1:]] for name in dtype.names or ()) + "\n"
        return lambda block: "".join([line % row for row in block.tolist()]).encode()
    options = csv.WriteOptions(include_header=False)

    def text(block: Block) -> bytes:
        columns = {name: np.ascontiguousarray(block[name]) for name in dtype.names or ()}
        sink = pa.BufferOutputStream()
        csv.write_csv(pa.table(columns), sink, options)
        return bytes(sink.getvalue())

    return text


def _write_parquet(
    path: Path,
    dtype: np.dtype[np.void],
    blocks: Iterator[Block],
    record: Record,
    metadata: dict[str, Any],
) -> int:
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise RecordError(
            "Parquet needs the package pyarrow: pip install 'motord[parquet]'; "
            "or choose a name that ends with .csv"
        ) from error
    known = {f.name: {"unit": f.unit, "meaning": f.meaning} for f in record.fields}
    fields = [
        pa.field(name, pa.from_numpy_dtype(dtype[name]), metadata=known.get(name))
        for name in dtype.names or ()
    ]
    schema = pa.schema(fields, metadata={"motord": to_json(metadata)})
    count = 0
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for group in _gathered(blocks, ROW_GROUP_ROWS):
            columns = [np.ascontiguousarray(group[name]) for name in schema.names]
            writer.write_table(pa.table(columns, schema=schema))
            count += len(group)
    return count


def _gathered(blocks: Iterator[Block], size: int) -> Iterator[Block]:
    """Yield blocks of at least `size` rows, but for the last."""
    waiting: list[Block] = []
    for block in blocks:
        waiting.append(block)
        if sum(map(len, waiting)) >= size:
            yield np.concatenate(waiting)
            waiting = []
    if waiting:
        yield np.concatenate(waiting)
