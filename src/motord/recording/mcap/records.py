"""Records of an MCAP file, read and written with the `mcap` library."""

import struct
from collections.abc import Iterable
from typing import Any

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

MAGIC = b"\x89MCAP0\r\n"
"""Beginning and end of an MCAP file."""

RECORD_HEAD = struct.Struct("<BQ")
"""Opcode and length of any record."""

PARSED: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.DATA_END: DataEnd,
}
"""Records that `parse` knows, by their opcodes."""


class _RecordStream(ReadDataStream):
    """The bytes of a record, read in order; `count` goes beyond them if more is asked for.

    The library's own does more at each read, of which a summary takes hundreds.
    """

    def __init__(self, body: bytes) -> None:
        self._body, self._count = body, 0

    def read(self, length: int) -> bytes:
        start, self._count = self._count, self._count + length
        return self._body[start : self._count]


def parse(opcode: int, body: bytes) -> Any:
    """Return the record of an opcode in `PARSED`. Raises ValueError if `body` is not one."""
    stream = _RecordStream(body)
    try:
        record = PARSED[opcode].read(stream)
    except struct.error as error:
        raise ValueError("a record is damaged") from error
    if stream.count != len(body):
        raise ValueError("a record is damaged")
    return record


def serialise(records: Iterable[McapRecord]) -> bytes:
    """Return the bytes of `records`, one after the other."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
