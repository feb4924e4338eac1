"""The structure of a file without a valid summary: unfinished, cut off, damaged.

The file is scanned from record to record. Where bytes are no record the scan goes on at the next
chunk whose content is right, and what was skipped is noted. (The library's reader ends there.)
"""

import mmap
import re
import struct
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import DataEnd, Footer

from motord.recording.damage import Loss
from motord.recording.mcap.chunk_decoder import (
    HEAD_MAX_BYTES,
    ChunkError,
    chunk_content,
    chunk_head,
)
from motord.recording.mcap.records import MAGIC, PARSED, RECORD_HEAD, parse
from motord.recording.mcap.summary import FOOTER_BYTES, ChunkEntry, Structure

_KNOWN = tuple(Opcode)
_INDEX = struct.Struct("<HI")  # channel and size of a message index
_BODY_MAX_BYTES = 64 << 20  # of a record that is read whole
_CHUNK = re.compile(
    rb"\x06.{5}\x00{3}.{16}.{5}\x00{3}.{4}(?:\x04\x00{3}zstd|\x03\x00{3}lz4|\x00{4}).{5}\x00{3}",
    re.DOTALL,
)
"""How a Chunk record begins, as far as that is known; for sizes below 1 TiB."""


class _Bad(ValueError):
    """The bytes at a place are no record."""


class Salvage:
    """One scan of `file` of `size` bytes, which starts with the magic of MCAP."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file = file
        self._size = size
        self._searched_to = len(MAGIC)  # all chunks before this place are known
        self._structure = Structure(size, indexed=False)
        self._finished = False

    def structure(self) -> Structure:
        """Scan from the first record to the end of the file."""
        place = len(MAGIC)
        while place < self._size and not self._finished:
            try:
                place = self._step(place)
            except _Bad as error:
                place = self._find_chunk(place, str(error))
        if not self._finished and not self._ends_in_loss():
            closed = self._structure.data_end is not None
            self._lose(self._size, 0, "the recording was not closed", messages=not closed)
        return self._structure

    def _step(self, place: int) -> int:
        """Read the record at `place` and return the place of the next. Raises _Bad."""
        head = self._read(place, HEAD_MAX_BYTES)
        if len(head) < RECORD_HEAD.size:
            raise _Bad("cut off")
        opcode, length = RECORD_HEAD.unpack_from(head)
        end: int = place + RECORD_HEAD.size + length
        if opcode not in _KNOWN:
            raise _Bad("not a record")
        if end > self._size:
            raise _Bad("cut off")
        if opcode == Opcode.CHUNK:
            self._chunk(place, head)
        elif opcode == Opcode.FOOTER:
            self._finish(place, length)
        elif opcode in PARSED:
            self._parsed(opcode, place, length)
        elif opcode == Opcode.MESSAGE_INDEX:
            _check_index(head[RECORD_HEAD.size :], length)
        elif opcode == Opcode.MESSAGE:
            self._structure.loose_messages = True
        return end

    def _read(self, place: int, size: int) -> bytes:
        self._file.seek(place)
        return self._file.read(size)

    def _chunk(self, place: int, head_bytes: bytes) -> None:
        try:
            head = chunk_head(head_bytes)
        except ChunkError as error:
            raise _Bad(str(error)) from error
        entry = ChunkEntry(place, head.size, head.start_ns, head.end_ns, head.content_size, None)
        self._structure.chunks.append(entry)
        self._searched_to = place + head.size

    def _parsed(self, opcode: int, place: int, length: int) -> None:
        if length > _BODY_MAX_BYTES:
            raise _Bad("not a record")
        try:
            record = parse(opcode, self._read(place + RECORD_HEAD.size, length))
        except ValueError as error:
            raise _Bad(str(error)) from error
        if isinstance(record, DataEnd):
            self._structure.data_end = place
            self._structure.data_crc = record.data_section_crc
        else:
            self._structure.keep(record)

    def _finish(self, place: int, length: int) -> None:
        """End the scan at a footer; what is wrong with a summary costs no messages."""
        if length != FOOTER_BYTES - RECORD_HEAD.size:
            raise _Bad("not a record")
        self._finished = True
        content = self._read(place, FOOTER_BYTES + len(MAGIC) + 1)
        footer: Footer = parse(Opcode.FOOTER, content[RECORD_HEAD.size : FOOTER_BYTES])
        if footer.summary_start or content[FOOTER_BYTES:] != MAGIC:
            self._lose(place, self._size - place, "the index is damaged", messages=False)

    def _find_chunk(self, place: int, reason: str) -> int:
        """Return the place of the next good chunk, or the end of the file; note what is lost."""
        with mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            found = _next_chunk(content, self._searched_to)
        end = self._size if found is None else found
        start = place if place < end else self._searched_to
        closed = found is None and self._structure.data_end is not None
        reason = reason if found is None else "not readable"
        self._lose(start, end - start, reason, messages=not closed)
        return end

    def _lose(self, place: int, size: int, reason: str, *, messages: bool = True) -> None:
        self._structure.losses.append(Loss(place, size, reason, messages=messages))

    def _ends_in_loss(self) -> bool:
        losses = self._structure.losses
        return bool(losses) and losses[-1].offset + losses[-1].size == self._size


def _check_index(body: bytes, length: int) -> None:
    """Raise _Bad if the sizes in a message index contradict each other."""
    if length < _INDEX.size or _INDEX.unpack_from(body)[1] != length - _INDEX.size:
        raise _Bad("not a record")


def _next_chunk(content: mmap.mmap, start: int) -> int | None:
    """Return the place of the first chunk from `start` on whose content is right, or None."""
    match = _CHUNK.search(content, start)
    while match:
        place = match.start()
        try:
            size = chunk_head(content[place : place + HEAD_MAX_BYTES]).size
            chunk_content(memoryview(content[place : place + size]))
        except ChunkError:
            match = _CHUNK.search(content, place + 1)
        else:
            return place
    return None
