"""A recording as a sequence of checked chunks, with an account of those that are not readable.

Schemas and channels of an unfinished file are under no checksum. The numbers of motord's topics and
of their fields are promises, so what is missing there is known.
"""

import os
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from isal.isal_zlib import crc32
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from motord.recording import topics
from motord.recording.damage import Damage, Loss, damage_of
from motord.recording.errors import RecordError
from motord.recording.file_names import part_of
from motord.recording.json_encoding import from_strings
from motord.recording.mcap.chunk_builder import CAPACITY_BYTES
from motord.recording.mcap.chunk_decoder import ChunkError, DecodedChunk, decode
from motord.recording.mcap.message_array import MessageArray, messages_of
from motord.recording.mcap.records import MAGIC
from motord.recording.mcap.salvage import Salvage
from motord.recording.mcap.summary import ChunkEntry, Structure, read_summary
from motord.recording.topics import Topic
from motord.wire.ticks.blocks import codec_of
from motord.wire.ticks.proto_text import read_record

_READ_AT_ONCE_BYTES = 1 << 20


@dataclass(frozen=True)
class Span:
    """A span of time, Unix ns, both ends included."""

    from_ns: int = -(1 << 64)
    to_ns: int = 1 << 64

    def overlaps(self, entry: ChunkEntry) -> bool:
        """Return whether a chunk may have messages in it, by what its index says."""
        return entry.end_ns >= self.from_ns and entry.start_ns <= self.to_ns

    def contains(self, times_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which times (n,) are within it, shape (n,)."""
        return (times_ns >= self.from_ns) & (times_ns <= self.to_ns)


ALWAYS = Span()


class ChunkSource:
    """The file `path`: its structure, its chunks, its losses.

    One descriptor is open from the first look to the end of the object: a file that gets its final
    name, is replaced or removed meanwhile goes on being the one whose structure is known. Raises
    RecordError if it cannot be read or is not an MCAP file with messages in chunks.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor = _open(path)
        weakref.finalize(self, os.close, self._descriptor)
        self.structure = self._read_structure()
        self._losses = {(loss.offset, loss.reason): loss for loss in self.structure.losses}
        self._bad_chunks: set[int] = set()
        if self.structure.loose_messages and not self.structure.chunks:
            raise RecordError(f"{path}: its messages are not in chunks; rewrite it with chunks")
        repair_schemas(self.structure)
        self.layouts = dict(self._layouts())

    @property
    def damage(self) -> Damage | None:
        """What is known so far to be missing; None if nothing is."""
        return damage_of(map(self._between, self._losses.values()))

    def number(self, topic: str) -> int | None:
        """Return the number of the channel of `topic`, None if the file has none."""
        numbers = [n for n, channel in self.structure.channels.items() if channel.topic == topic]
        return numbers[0] if numbers else None

    def chunks(self, channel: int | None = None, span: Span = ALWAYS) -> Iterator[ChunkEntry]:
        """Yield the chunks that may have messages of `channel` (None: any) within `span`."""
        for entry in self.structure.chunks:
            has_it = channel is None or entry.channels is None or channel in entry.channels
            unchecked = not self.structure.indexed  # then a chunk's times may be wrong
            if has_it and (unchecked or span.overlaps(entry)):
                yield entry

    def read(self, chunks: Iterable[ChunkEntry]) -> Iterator[DecodedChunk]:
        """Yield those of `chunks` that are good; note the others."""
        # glibc returns freed blocks to the system until it has freed one as large: reading is then
        # a quarter slower, for page faults
        np.empty(CAPACITY_BYTES, np.uint8)
        for entry in chunks:
            size = min(entry.size, self.structure.size)
            try:
                record = memoryview(os.pread(self._descriptor, size, entry.offset))
                chunk = decode(record, self.layouts)
            except ChunkError as error:
                self._bad_chunks.add(entry.offset)
                times = (entry.start_ns, entry.end_ns) if self.structure.indexed else ()
                self._note(Loss(entry.offset, entry.size, str(error), *times))
            except OSError as error:
                raise RecordError(f"{self.path}: cannot read it: {error.strerror}") from error
            else:
                yield chunk

    def metadata(self, name: str) -> dict[str, Any]:
        """Return the values of a metadata record, empty if there is none.

        What is not the JSON that it should be stays text, and is noted.
        """
        strings = self.structure.metadata.get(name, {})
        try:
            return from_strings(strings)
        except ValueError:
            reason = f"the metadata record {name} is damaged"
            self._note(Loss(0, 0, reason, messages=False))
            return dict(strings)

    def check_outside_chunks(self) -> None:
        """Note a loss if bytes outside the chunks have changed, as far as a checksum shows."""
        end, wanted = self.structure.data_end, self.structure.data_crc
        if end is None or wanted == 0 or self._losses:
            return
        crc, place = 0, 0
        while piece := os.pread(self._descriptor, min(end - place, _READ_AT_ONCE_BYTES), place):
            crc = crc32(piece, crc)
            place += len(piece)
        if crc != wanted:
            reason = "checksum wrong outside the chunks: metadata or indexes have changed"
            self._note(Loss(0, 0, reason, messages=False))

    def _read_structure(self) -> Structure:
        try:
            with open(self._descriptor, "rb", closefd=False) as file:
                size = file.seek(0, os.SEEK_END)
                file.seek(0)
                if size == 0:
                    raise RecordError(f"{self.path}: is empty")
                if file.read(len(MAGIC)) != MAGIC:
                    raise RecordError(f"{self.path}: is not an MCAP file")
                return read_summary(file, size) or Salvage(file, size).structure()
        except OSError as error:
            raise RecordError(f"{self.path}: cannot read it: {error.strerror}") from error

    def _note(self, loss: Loss) -> None:
        self._losses[loss.offset, loss.reason] = loss

    def _between(self, loss: Loss) -> Loss:
        """Return `loss` with the times of the good chunks around it, where it has none.

        Chunks overlap in time: the one after it may begin before that before it ends.
        """
        if loss.from_ns is not None or loss.to_ns is not None:
            return loss
        good = [c for c in self.structure.chunks if c.offset not in self._bad_chunks]
        before = [c.end_ns for c in good if c.offset < loss.offset]
        after = [c.start_ns for c in good if c.offset >= loss.offset + loss.size]
        from_ns, to_ns = max(before, default=None), min(after, default=None)
        if from_ns is not None and to_ns is not None:
            from_ns, to_ns = min(from_ns, to_ns), max(from_ns, to_ns)
        return replace(loss, from_ns=from_ns, to_ns=to_ns)

    def _layouts(self) -> Iterator[tuple[int, MessageArray]]:
        """Yield the channels that have messages of fixed layout."""
        for number, channel in self.structure.channels.items():
            schema = self.structure.schemas.get(channel.schema_id)
            if schema is None or channel.message_encoding != topics.PROTOBUF:
                continue
            try:
                record = read_record(schema.data, schema.name)
            except ValueError:
                continue
            if record.fields:
                yield number, messages_of(number, record)


def _open(path: Path) -> int:
    """Return a descriptor of `path`. Raises RecordError if it cannot be read."""
    try:
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        part = part_of(path)
        hint = f"; {part} is there, not closed, and can be read" if part.exists() else ""
        raise RecordError(f"{path}: cannot read it: {error.strerror}{hint}") from error


def repair_schemas(structure: Structure) -> None:
    """Put back what is missing or damaged in a file of motord without an index."""
    library = structure.library  # empty if the header is not readable
    by_motord = library == "" or library.startswith("motord")
    if structure.indexed or not structure.chunks or not by_motord:
        return
    for topic in topics.ALL:
        known = structure.channels.get(topic.number)
        if library == "" and known is not None:
            continue
        if not _usable(structure.schemas.get(topic.number), known, topic):
            structure.schemas[topic.number] = topic.schema
        for number, channel in list(structure.channels.items()):
            if channel.topic == topic.name:
                del structure.channels[number]
        structure.channels[topic.number] = topic.channel


def _usable(schema: Schema | None, channel: Channel | None, topic: Topic) -> bool:
    """Return whether a schema that no checksum covers is one that a version of motord wrote."""
    if schema is None or schema.name != topic.schema.name:
        return False
    if topic.record is None or schema.data == topic.schema.data:
        return True
    try:
        found = read_record(schema.data, schema.name)
        claimed_bytes = int(channel.metadata[topics.MESSAGE_BYTES]) if channel else 0
    except (ValueError, KeyError):
        return False
    pairs = zip(found.fields, topic.record.fields, strict=False)  # fields are only ever appended
    return claimed_bytes == codec_of(found).size and all(
        (a.number, a.name, a.kind) == (b.number, b.name, b.kind) for a, b in pairs
    )
