"""The structure of a finished file, from its summary section."""

import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, DataEnd, McapRecord, MetadataIndex, Statistics

from motord.record.container import MAGIC
from motord.record.damage import Loss
from motord.record.rows import RECORD_HEAD
from motord.record.structure import PARSED, ChunkEntry, Structure, parse

FOOTER = struct.Struct("<BQQQI")
"""Opcode, length, start of the summary, start of its offsets, checksum."""

_TAIL_BYTES = FOOTER.size + len(MAGIC)
_DATA_END_BYTES = RECORD_HEAD.size + 4


def read_summary(file: BinaryIO, size: int) -> Structure | None:
    """Return the structure that the summary of `file` tells, None if it has no valid one."""
    if size < len(MAGIC) + _TAIL_BYTES:
        return None
    tail = _read(file, size - _TAIL_BYTES, _TAIL_BYTES)
    opcode, length, start, _, crc = FOOTER.unpack_from(tail)
    if (opcode, length) != (Opcode.FOOTER, FOOTER.size - RECORD_HEAD.size):
        return None
    records_end = size - _TAIL_BYTES
    if not tail.endswith(MAGIC) or not len(MAGIC) + _DATA_END_BYTES <= start <= records_end:
        return None
    summary = _read(file, start, records_end - start)
    if crc not in (0, zlib.crc32(tail[: FOOTER.size - 4], zlib.crc32(summary))):
        return None
    try:
        structure = Structure(size, indexed=True)
        for record in _records(summary):
            _take(structure, record, file)
        _data_end(structure, _read(file, start - _DATA_END_BYTES, _DATA_END_BYTES), start)
    except ValueError:
        return None
    return structure


def _read(file: BinaryIO, offset: int, size: int) -> bytes:
    file.seek(offset)
    return file.read(size)


def _records(content: bytes) -> Iterator[McapRecord]:
    """Yield the records of a summary section. Raises ValueError."""
    offset = 0
    while offset < len(content):
        if offset + RECORD_HEAD.size > len(content):
            raise ValueError("a record is damaged")
        opcode, length = RECORD_HEAD.unpack_from(content, offset)
        offset += RECORD_HEAD.size
        if opcode in PARSED:
            yield parse(opcode, content[offset : offset + length])
        offset += length


def _take(structure: Structure, record: McapRecord, file: BinaryIO) -> None:
    structure.keep(record)
    if isinstance(record, ChunkIndex):
        structure.chunks.append(_entry(record))
    elif isinstance(record, Statistics):
        structure.counts = record.channel_message_counts
        structure.loose_messages = record.message_count > 0 and record.chunk_count == 0
    elif isinstance(record, MetadataIndex):
        _take_metadata(structure, record, file)


def _entry(record: ChunkIndex) -> ChunkEntry:
    channels = frozenset(record.message_index_offsets)
    return ChunkEntry(
        record.chunk_start_offset,
        record.chunk_length,
        record.message_start_time,
        record.message_end_time,
        record.uncompressed_size,
        channels or None,
    )


def _take_metadata(structure: Structure, index: MetadataIndex, file: BinaryIO) -> None:
    content = _read(file, index.offset, index.length)
    try:
        structure.keep(parse(Opcode.METADATA, content[RECORD_HEAD.size :]))
    except ValueError:
        reason = f"the metadata record {index.name} is damaged"
        structure.losses.append(Loss(index.offset, index.length, reason, messages=False))


def _data_end(structure: Structure, content: bytes, start: int) -> None:
    """Note where the messages end: just before the summary, which starts at `start`."""
    record = parse(Opcode.DATA_END, content[RECORD_HEAD.size :])
    if isinstance(record, DataEnd) and content[0] == Opcode.DATA_END:
        structure.data_end = start - _DATA_END_BYTES
        structure.data_crc = record.data_section_crc
