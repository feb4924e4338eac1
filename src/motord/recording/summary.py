"""The structure of a finished file, from its summary section."""

import struct
from collections.abc import Iterator
from typing import BinaryIO

from isal.isal_zlib import crc32
from mcap.opcode import Opcode
from mcap.records import DataEnd, McapRecord, MetadataIndex, Statistics

from motord.recording.damage import Loss
from motord.recording.mcap_file import MAGIC
from motord.recording.message_array import RECORD_HEAD
from motord.recording.structure import PARSED, ChunkEntry, Structure, parse

FOOTER = struct.Struct("<BQQQI")
"""Opcode, length, start of the summary, start of its offsets, checksum."""

_INDEX_HEAD = struct.Struct("<QQQQI")  # times, place and length of the chunk, bytes of what follows
_PLACE = struct.Struct("<HQ")  # channel, and where its message index is
_INDEX_LABEL = struct.Struct("<QI")  # length of the indexes, and of the compression's name
_INDEX_SIZES = struct.Struct("<QQ")  # of the content, compressed and not

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
    if crc not in (0, crc32(tail[: FOOTER.size - 4], crc32(summary))):
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


def _take(structure: Structure, record: McapRecord | ChunkEntry, file: BinaryIO) -> None:
    if isinstance(record, ChunkEntry):
        structure.chunks.append(record)
        return
    structure.keep(record)
    if isinstance(record, Statistics):
        structure.counts = record.channel_message_counts
        structure.loose_messages = record.message_count > 0 and record.chunk_count == 0
    elif isinstance(record, MetadataIndex):
        _take_metadata(structure, record, file)


def chunk_entry(body: bytes) -> ChunkEntry:
    """Return what a ChunkIndex record says. Raises ValueError.

    A long run has thousands of them; the library takes 50 us for each.
    """
    try:
        start_ns, end_ns, offset, size, places_size = _INDEX_HEAD.unpack_from(body)
        end = _INDEX_HEAD.size + places_size
        channels = [channel for channel, _ in _PLACE.iter_unpack(body[_INDEX_HEAD.size : end])]
        _, label = _INDEX_LABEL.unpack_from(body, end)
        _, content_size = _INDEX_SIZES.unpack_from(body, end + _INDEX_LABEL.size + label)
    except struct.error as error:
        raise ValueError("a record is damaged") from error
    if len(body) != end + _INDEX_LABEL.size + label + _INDEX_SIZES.size:
        raise ValueError("a record is damaged")
    return ChunkEntry(offset, size, start_ns, end_ns, content_size, frozenset(channels) or None)


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
