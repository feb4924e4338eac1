"""Records of an MCAP file, read and written with the `mcap` library."""

import struct
from collections.abc import Iterable
from io import BytesIO
from typing import Any

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import EndOfFile
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


class _StrictStream(ReadDataStream):
    """A stream whose reads give all that was asked for. Raises EndOfFile if it ends before."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) != length:
            raise EndOfFile
        return data


def parse(opcode: int, body: bytes) -> Any:
    """Return the record of an opcode in `PARSED`. Raises ValueError if `body` is not one."""
    stream = _StrictStream(BytesIO(body))
    try:
        record = PARSED[opcode].read(stream)
    except (struct.error, EndOfFile) as error:
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
