"""What is where in an MCAP file, and how that follows from the summary of a finished one."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO

from isal.isal_zlib import crc32
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from motord.recording.damage import Loss
from motord.recording.mcap.records import MAGIC, PARSED, RECORD_HEAD, parse

FOOTER_BYTES = RECORD_HEAD.size + 8 + 8 + 4
"""Of the record: start of the summary, start of its offsets, checksum."""

_INDEX_HEAD = struct.Struct("<QQQQI")  # times, offset and length of the chunk, bytes that follow
_INDEX_OFFSET = struct.Struct("<HQ")  # channel, and the offset of its message index
_INDEX_LABEL = struct.Struct("<QI")  # length of the indexes, and of the compression's name
_INDEX_SIZES = struct.Struct("<QQ")  # of the content, compressed and not

_TAIL_BYTES = FOOTER_BYTES + len(MAGIC)
_DATA_END_BYTES = RECORD_HEAD.size + 4


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

    `indexed`: it comes from the file's own summary; only then are there `counts`, the number of
    messages of each channel. `data_end` is the offset of the record that ends the messages, None
    if there is none; `data_crc` the checksum of all before it, 0 for none. `loose_messages`: there
    are messages outside chunks; `library`: what wrote the file.
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


def read_summary(file: BinaryIO, size: int) -> Structure | None:
    """Return the structure by the summary of `file`, None if it has no valid one.

    The library's reader believes what a summary says; here checksum and lengths are checked.
    """
    records_end = size - _TAIL_BYTES
    if records_end < len(MAGIC):
        return None
    tail = _read(file, records_end, _TAIL_BYTES)
    if RECORD_HEAD.unpack_from(tail) != (Opcode.FOOTER, FOOTER_BYTES - RECORD_HEAD.size):
        return None
    footer: Footer = parse(Opcode.FOOTER, tail[RECORD_HEAD.size : FOOTER_BYTES])
    start = footer.summary_start
    if not tail.endswith(MAGIC) or not len(MAGIC) + _DATA_END_BYTES <= start <= records_end:
        return None
    summary = _read(file, start, records_end - start)
    if footer.summary_crc not in (0, crc32(tail[: FOOTER_BYTES - 4], crc32(summary))):
        return None
    structure = Structure(size, indexed=True)
    try:
        for record in _records(summary):
            _keep(structure, record, file)
    except ValueError:
        return None
    data_end = _read(file, start - _DATA_END_BYTES, _DATA_END_BYTES)
    if data_end[0] == Opcode.DATA_END:
        end: DataEnd = parse(Opcode.DATA_END, data_end[RECORD_HEAD.size :])
        structure.data_end, structure.data_crc = start - _DATA_END_BYTES, end.data_section_crc
    return structure


def _read(file: BinaryIO, offset: int, size: int) -> bytes:
    file.seek(offset)
    return file.read(size)


def _records(content: bytes) -> Iterator[McapRecord | ChunkEntry]:
    """Yield the records of a summary section. Raises ValueError."""
    offset = 0
    while offset < len(content):
        if offset + RECORD_HEAD.size > len(content):
            raise ValueError("a record is damaged")
        opcode, length = RECORD_HEAD.unpack_from(content, offset)
        offset += RECORD_HEAD.size
        body = content[offset : offset + length]
        if opcode == Opcode.CHUNK_INDEX:
            yield chunk_entry(body)
        elif opcode in PARSED:
            yield parse(opcode, body)
        offset += length


def chunk_entry(body: bytes) -> ChunkEntry:
    """Return what a ChunkIndex record says. Raises ValueError.

    A long run has thousands of them; the library takes 50 us for each.
    """
    try:
        start_ns, end_ns, offset, size, offsets_size = _INDEX_HEAD.unpack_from(body)
        end = _INDEX_HEAD.size + offsets_size
        offsets = _INDEX_OFFSET.iter_unpack(body[_INDEX_HEAD.size : end])
        channels = frozenset(channel for channel, _ in offsets)
        _, label = _INDEX_LABEL.unpack_from(body, end)
        _, content_size = _INDEX_SIZES.unpack_from(body, end + _INDEX_LABEL.size + label)
    except struct.error as error:
        raise ValueError("a record is damaged") from error
    if len(body) != end + _INDEX_LABEL.size + label + _INDEX_SIZES.size:
        raise ValueError("a record is damaged")
    return ChunkEntry(offset, size, start_ns, end_ns, content_size, channels or None)


def _keep(structure: Structure, record: McapRecord | ChunkEntry, file: BinaryIO) -> None:
    """Take over a record. Raises ValueError for an index of what is beyond the file."""
    if isinstance(record, ChunkEntry):
        _require_within(structure, record.offset + record.size)
        structure.chunks.append(record)
    elif isinstance(record, Statistics):
        structure.counts = record.channel_message_counts
        structure.loose_messages = record.message_count > 0 and record.chunk_count == 0
    elif isinstance(record, MetadataIndex):
        _require_within(structure, record.offset + record.length)
        content = _read(file, record.offset, record.length)
        try:
            structure.keep(parse(Opcode.METADATA, content[RECORD_HEAD.size :]))
        except ValueError:
            reason = f"the metadata record {record.name} is damaged"
            structure.losses.append(Loss(record.offset, record.length, reason, messages=False))
    else:
        structure.keep(record)


def _require_within(structure: Structure, end: int) -> None:
    if end > structure.size:
        raise ValueError("an index points beyond the file")
