"""What is where in an MCAP file, and how its small records are read."""

import struct
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from motord.recording.damage import Loss

PARSED: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.DATA_END: DataEnd,
}
"""Records that are read whole, by their opcodes."""


@dataclass(frozen=True)
class ChunkEntry:
    """A chunk's place; `channels` are those that it has messages of, None if not known."""

    offset: int
    size: int
    start_ns: int
    end_ns: int
    content_size: int
    channels: frozenset[int] | None


@dataclass
class Structure:
    """What is in a file, and which parts of it are not readable.

    `indexed` tells that it comes from the file's own summary; only then are there `counts`, the
    number of messages of each channel. `data_end` is the offset of the record that ends the
    messages, None if there is none; `data_crc` the checksum of all before it, 0 for none.
    `loose_messages` tells of messages that are in no chunk; `library` is what wrote the file.
    """

    size: int
    indexed: bool
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    chunks: list[ChunkEntry] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)
    data_end: int | None = None
    data_crc: int = 0
    loose_messages: bool = False
    library: str = ""

    def keep(self, record: McapRecord) -> None:
        """Take over header, schemas, channels and metadata, the first of each; ignore others."""
        if isinstance(record, Schema):
            self.schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            self.channels.setdefault(record.id, record)
        elif isinstance(record, Metadata):
            self.metadata.setdefault(record.name, record.metadata)
        elif isinstance(record, Header):
            self.library = record.library


class _Strict(ReadDataStream):
    """A stream whose reads give all that was asked for. Raises EndOfFile if it ends before."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) != length:
            raise EndOfFile
        return data


def parse(opcode: int, body: bytes) -> McapRecord:
    """Return the record of an opcode in `PARSED`. Raises ValueError if `body` is not one."""
    stream = _Strict(BytesIO(body))
    try:
        record: McapRecord = PARSED[opcode].read(stream)
    except (struct.error, EndOfFile) as error:
        raise ValueError("a record is damaged") from error
    if stream.count != len(body):
        raise ValueError("a record is damaged")
    return record
