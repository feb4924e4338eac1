"""The content of a chunk: checked, decompressed, taken apart."""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from isal.isal_zlib import crc32
from mcap.opcode import Opcode

from motord.recording.mcap.chunk_builder import Index
from motord.recording.mcap.compression import decompress
from motord.recording.mcap.message_array import HEAD, MessageArray
from motord.recording.mcap.records import RECORD_HEAD
from motord.wire.ticks.pattern import Bytes

_CHUNK_HEAD = struct.Struct("<BQQQQII")
"""Opcode, length, first and last time, size and CRC of the content, length of the compression."""

_LABEL_MAX_BYTES = 16  # of the name of a compression
HEAD_MAX_BYTES = _CHUNK_HEAD.size + _LABEL_MAX_BYTES + 8


class ChunkError(ValueError):
    """A chunk that cannot be used; the message says why."""


@dataclass(frozen=True)
class ChunkHead:
    """What a Chunk record says of itself. `data_offset` counts from its beginning."""

    start_ns: int
    end_ns: int
    content_size: int
    crc: int
    compression: str
    data_offset: int
    size: int


def chunk_head(record: bytes | memoryview) -> ChunkHead:
    """Read the beginning of a Chunk record, at least `HEAD_MAX_BYTES` or all of it.

    Raises ChunkError if it contradicts itself.
    """
    try:
        opcode, length, start_ns, end_ns, content, crc, label = _CHUNK_HEAD.unpack_from(record)
        if opcode != Opcode.CHUNK or label > _LABEL_MAX_BYTES:
            raise ChunkError("not a chunk")
        data = _CHUNK_HEAD.size + label + 8
        (compressed,) = struct.unpack_from("<Q", record, data - 8)
        name = bytes(record[_CHUNK_HEAD.size : data - 8]).decode("ascii")
    except (struct.error, UnicodeDecodeError) as error:
        raise ChunkError("not a chunk") from error
    if length != data - RECORD_HEAD.size + compressed:
        raise ChunkError("its lengths contradict each other")
    return ChunkHead(start_ns, end_ns, content, crc, name, data, data + compressed)


def chunk_content(record: memoryview) -> memoryview:
    """Return the content of a whole Chunk record. Raises ChunkError if it is damaged."""
    head = chunk_head(record)
    if head.size != len(record):
        raise ChunkError("its lengths contradict each other")
    try:
        content = decompress(head.compression, record[head.data_offset :], head.content_size)
    except ValueError as error:
        raise ChunkError(f"chunk {error}") from error
    if head.crc not in (0, crc32(content)):
        raise ChunkError("chunk checksum wrong")
    return memoryview(content)


@dataclass(frozen=True)
class MessageBlock:
    """Messages of fixed layout in a row: `records` (n, size) of `layout`, from `offset` on."""

    layout: MessageArray
    records: Bytes
    offset: int

    @property
    def channel(self) -> int:
        """Number of their channel."""
        return self.layout.channel

    def index(self) -> Index:
        """Return log time and offset in the chunk of every message, shape (n, 2)."""
        return self.layout.index(self.layout.times_ns(self.records), self.offset)


@dataclass(frozen=True)
class SingleMessage:
    """One message of any other channel."""

    channel: int
    log_time_ns: int
    payload: memoryview
    offset: int

    def index(self) -> Index:
        """Return its log time and offset in the chunk, shape (1, 2)."""
        return np.array([[self.log_time_ns, self.offset]], np.uint64)


def messages(
    content: memoryview, layouts: Mapping[int, MessageArray]
) -> Iterator[MessageBlock | SingleMessage]:
    """Yield the messages in a chunk in order, those of the channels in `layouts` as blocks.

    Raises ChunkError for a record that does not fit, or a message that is not as its layout says.
    """
    raw, offset = np.frombuffer(content, np.uint8), 0
    while offset < len(content):
        opcode, end = _record(content, offset)
        if opcode != Opcode.MESSAGE:
            offset = end
            continue
        if end - offset < HEAD.size:
            raise ChunkError("a message in it is too short")
        _, _, channel, _, log_time_ns, _ = HEAD.unpack_from(content, offset)
        layout = layouts.get(channel)
        if layout is None:
            yield SingleMessage(channel, log_time_ns, content[offset + HEAD.size : end], offset)
            offset = end
            continue
        records = layout.leading(raw[offset:])
        if not len(records):
            raise ChunkError(f"a message in it is not a {layout.codec.record.name} of fixed layout")
        yield MessageBlock(layout, records, offset)
        offset += records.size


@dataclass(frozen=True)
class DecodedChunk:
    """A whole chunk: its record, its content, and the messages in it in order."""

    record: memoryview
    content: memoryview
    messages: list[MessageBlock | SingleMessage]

    def index(self) -> dict[int, Index]:
        """Return log times and offsets of the messages of every channel."""
        index: dict[int, list[Index]] = {}
        for part in self.messages:
            index.setdefault(part.channel, []).append(part.index())
        return {channel: np.concatenate(parts) for channel, parts in index.items()}


def decode(record: memoryview, layouts: Mapping[int, MessageArray]) -> DecodedChunk:
    """Take a whole Chunk record apart; see `messages`. Raises ChunkError."""
    content = chunk_content(record)
    return DecodedChunk(record, content, list(messages(content, layouts)))


def _record(content: memoryview, offset: int) -> tuple[int, int]:
    """Return opcode and end of the record at `offset`."""
    if offset + RECORD_HEAD.size <= len(content):
        opcode, length = RECORD_HEAD.unpack_from(content, offset)
        end = offset + RECORD_HEAD.size + length
        if end <= len(content):
            return opcode, end
    raise ChunkError("a record in it does not fit into it")
