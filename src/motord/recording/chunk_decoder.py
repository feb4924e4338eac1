"""The content of a chunk: checked, decompressed, taken apart."""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from isal.isal_zlib import crc32
from mcap.opcode import Opcode

from motord.recording.chunk import CHUNK_HEAD, Index
from motord.recording.compression import decompress
from motord.recording.message_array import HEAD, RECORD_HEAD, MessageRows
from motord.wire.ticks.pattern import Bytes

_LABEL_MAX_BYTES = 16  # of the name of a compression


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
        opcode, length, start_ns, end_ns, content, crc, label = CHUNK_HEAD.unpack_from(record)
        if opcode != Opcode.CHUNK or label > _LABEL_MAX_BYTES:
            raise ChunkError("not a chunk")
        data = CHUNK_HEAD.size + label + 8
        (compressed,) = struct.unpack_from("<Q", record, data - 8)
        name = bytes(record[CHUNK_HEAD.size : data - 8]).decode("ascii")
    except (struct.error, UnicodeDecodeError) as error:
        raise ChunkError("not a chunk") from error
    if length != data - RECORD_HEAD.size + compressed:
        raise ChunkError("its lengths contradict each other")
    return ChunkHead(start_ns, end_ns, content, crc, name, data, data + compressed)


HEAD_MAX_BYTES = CHUNK_HEAD.size + _LABEL_MAX_BYTES + 8


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
class DecodedRows:
    """Messages of fixed layout one after the other: `rows` (n, size) of `layout`."""

    layout: MessageRows
    rows: Bytes
    offset: int

    @property
    def channel(self) -> int:
        """Number of their channel."""
        return self.layout.channel

    def index(self) -> Index:
        """Return log time and offset in the chunk of every message, shape (n, 2)."""
        index = np.empty((len(self.rows), 2), np.uint64)
        index[:, 0] = self.layout.times_ns(self.rows)
        index[:, 1] = np.arange(len(self.rows)) * self.layout.size + self.offset
        return index


@dataclass(frozen=True)
class Single:
    """One message of any other channel."""

    channel: int
    log_time_ns: int
    payload: memoryview
    offset: int

    def index(self) -> Index:
        """Return its log time and offset in the chunk, shape (1, 2)."""
        return np.array([[self.log_time_ns, self.offset]], np.uint64)


def messages(
    content: memoryview, layouts: Mapping[int, MessageRows]
) -> Iterator[DecodedRows | Single]:
    """Yield the messages in a chunk in order, those of the channels in `layouts` as rows.

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
        if channel in layouts:
            run = DecodedRows(layouts[channel], layouts[channel].run(raw[offset:]), offset)
            if not len(run.rows):
                name = layouts[channel].codec.record.name
                raise ChunkError(f"a message in it is not a {name} of fixed layout")
            yield run
            offset += run.rows.size
        else:
            yield Single(channel, log_time_ns, content[offset + HEAD.size : end], offset)
            offset = end


def _record(content: memoryview, offset: int) -> tuple[int, int]:
    """Return opcode and end of the record at `offset`."""
    if offset + RECORD_HEAD.size <= len(content):
        opcode, length = RECORD_HEAD.unpack_from(content, offset)
        end = offset + RECORD_HEAD.size + length
        if end <= len(content):
            return opcode, end
    raise ChunkError("a record in it does not fit into it")
