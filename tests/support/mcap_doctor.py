"""What `mcap doctor` checks, with the records parsed by the `mcap` library: none of motord's code.

Header; schemas and channels (declared once, before use, alike in the summary); chunks (compression,
size, CRC, times); message indexes (one a channel, every message at its offset with its time); order
of log times; data end and footer with their CRCs; chunk indexes; statistics; metadata indexes;
summary offsets.
"""

import io
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zlib import crc32

import lz4.frame
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

MAGIC = b"\x89MCAP0\r\n"
_FRAME = struct.Struct("<BQ")


@dataclass(frozen=True)
class Framed:
    """A record: its opcode, where it begins, its whole length, and its parsed content."""

    opcode: int
    start: int
    length: int
    content: Any


def framed(raw: bytes, start: int, end: int) -> Iterator[Framed]:
    """Yield the records of `raw` from `start` on."""
    while start < end:
        opcode, size = _FRAME.unpack_from(raw, start)
        body = raw[start + _FRAME.size : start + _FRAME.size + size]
        assert len(body) == size, f"record at {start} ends after the file"
        yield Framed(opcode, start, _FRAME.size + size, parsed(opcode, body))
        start += _FRAME.size + size


def parsed(opcode: int, body: bytes) -> Any:
    kind = {
        Opcode.HEADER: records.Header, Opcode.FOOTER: records.Footer,
        Opcode.SCHEMA: records.Schema, Opcode.CHANNEL: records.Channel,
        Opcode.CHUNK: records.Chunk, Opcode.MESSAGE_INDEX: records.MessageIndex,
        Opcode.CHUNK_INDEX: records.ChunkIndex, Opcode.STATISTICS: records.Statistics,
        Opcode.METADATA: records.Metadata, Opcode.METADATA_INDEX: records.MetadataIndex,
        Opcode.SUMMARY_OFFSET: records.SummaryOffset, Opcode.DATA_END: records.DataEnd,
    }.get(Opcode(opcode))  # fmt: skip
    if kind is None:
        assert opcode == Opcode.MESSAGE, f"opcode {opcode}"
        return records.Message.read(ReadDataStream(io.BytesIO(body)), len(body))
    return kind.read(ReadDataStream(io.BytesIO(body)))


@dataclass
class Doctor:
    """Examines one file; `errors` and `warnings` are what is wrong with it."""

    errors: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    _schemas: dict[int, Any] = field(default_factory=dict)
    _channels: dict[int, Any] = field(default_factory=dict)
    _chunks: dict[int, Framed] = field(default_factory=dict)
    _index_lengths: Counter[int] = field(default_factory=Counter)
    _indexed: dict[int, dict[int, int]] = field(default_factory=dict)
    _metadata: dict[int, Framed] = field(default_factory=dict)
    _first_ns: int = 2**64
    _latest_ns: int = 0

    def _check(self, good: bool, error: str) -> None:
        if not good:
            self.errors.append(error)

    def examine(self, path: Path) -> "Doctor":
        raw = path.read_bytes()
        self._check(raw.startswith(MAGIC) and raw.endswith(MAGIC), "magic")
        everything = list(framed(raw, len(MAGIC), len(raw) - len(MAGIC)))
        ends = [i for i, one in enumerate(everything) if one.opcode == Opcode.DATA_END]
        self._check(everything[0].opcode == Opcode.HEADER, "the first record is no header")
        self._check(everything[-1].opcode == Opcode.FOOTER, "the last record is no footer")
        self._check(len(ends) == 1, f"{len(ends)} data ends")
        header = everything[0].content
        self._check(bool(header.library), "no library in the header")
        self._check(header.profile in ("", "ros1", "ros2"), f"profile {header.profile}")
        self._data(everything[1 : ends[0]])
        end = everything[ends[0]]
        self._check(
            end.content.data_section_crc in (0, crc32(raw[: end.start])), "CRC of the data section"
        )
        self._summary(raw, everything[ends[0] + 1 : -1], everything[-1])
        return self

    def _data(self, section: list[Framed]) -> None:
        chunk: Framed | None = None
        indexes: dict[int, Any] = {}
        for one in [*section, None]:
            if one is not None and one.opcode == Opcode.MESSAGE_INDEX:
                self._check(chunk is not None, "a message index without a chunk before it")
                channel = one.content.channel_id
                if channel in indexes:
                    self.warnings.append(f"two message indexes of channel {channel}")
                indexes[channel] = one.content
                if chunk is not None:
                    self._index_lengths[chunk.start] += one.length
                    self._indexed.setdefault(chunk.start, {})[channel] = one.start
                continue
            if chunk is not None:
                self._chunk(chunk, indexes)
            chunk, indexes = None, {}
            if one is None:
                return
            match one.opcode:
                case Opcode.CHUNK:
                    chunk = one
                    self._chunks[one.start] = one
                case Opcode.SCHEMA | Opcode.CHANNEL:
                    self._declared(one)
                case Opcode.METADATA:
                    self._metadata[one.start] = one
                case _:
                    self.errors.append(f"opcode {one.opcode} in the data section")

    def _declared(self, one: Framed, summary: bool = False) -> None:
        known = self._schemas if one.opcode == Opcode.SCHEMA else self._channels
        content, kind = one.content, type(one.content).__name__
        before = known.get(content.id)
        if isinstance(content, records.Schema):
            self._check(content.id != 0, "schema 0 is reserved")
            self._check(bool(content.encoding), f"schema {content.id} has no encoding")
        else:
            good = content.schema_id == 0 or content.schema_id in self._schemas
            self._check(good, f"channel {content.id}: schema {content.schema_id} is not known")
        if before is not None:
            self._check(before == content, f"two {kind} records {content.id} differ")
        if summary:
            self._check(before is not None, f"{kind} {content.id} is in the summary alone")
        elif before is not None:
            self.warnings.append(f"{kind} {content.id} twice in the data section")
        known[content.id] = content

    def _chunk(self, one: Framed, indexes: dict[int, Any]) -> None:
        chunk, where = one.content, f"chunk at {one.start}"
        match chunk.compression:
            case "":
                data = chunk.data
            case "zstd":
                data = zstandard.ZstdDecompressor().decompressobj().decompress(chunk.data)
            case "lz4":
                data = lz4.frame.decompress(chunk.data)
            case _:
                self.errors.append(f"{where}: compression {chunk.compression!r}")
                return
        self._check(len(data) == chunk.uncompressed_size, f"{where}: size")
        self._check(chunk.uncompressed_crc in (0, crc32(data)), f"{where}: CRC")
        times, found = [], set()
        for record in framed(data, 0, len(data)):
            if record.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._declared(record)
                continue
            self._check(record.opcode == Opcode.MESSAGE, f"{where}: opcode {record.opcode}")
            message = record.content
            self._check(message.channel_id in self._channels, f"{where}: channel not known")
            if message.log_time < self._latest_ns:
                self.warnings.append(f"{where}: log time {message.log_time} goes back")
            times.append(message.log_time)
            self._latest_ns = max(self._latest_ns, message.log_time)
            self._first_ns = min(self._first_ns, message.log_time)
            self.counts[message.channel_id] += 1
            found.add((message.channel_id, message.log_time, record.start))
        if times:
            self._check(chunk.message_start_time == min(times), f"{where}: start time")
            self._check(chunk.message_end_time == max(times), f"{where}: end time")
        listed = {(c, t, offset) for c, index in indexes.items() for t, offset in index.records}
        self._check(listed == found, f"{where}: message indexes differ from the messages")

    def _summary(self, raw: bytes, section: list[Framed], footer: Framed) -> None:
        content = footer.content
        starts = {one.start for one in section}
        self._check(content.summary_start == min(starts, default=0), "summary_start")
        offsets = [one for one in section if one.opcode == Opcode.SUMMARY_OFFSET]
        self._check(
            content.summary_offset_start == (offsets[0].start if offsets else 0),
            "summary_offset_start",
        )
        covered = raw[content.summary_start : footer.start + footer.length - 4]
        self._check(content.summary_crc in (0, crc32(covered)), "CRC of the summary")
        for kind in (Opcode.SCHEMA, Opcode.CHANNEL):
            for one in section:
                if one.opcode == kind:
                    self._declared(one, summary=True)
        self._chunk_indexes([one.content for one in section if one.opcode == Opcode.CHUNK_INDEX])
        self._statistics([one.content for one in section if one.opcode == Opcode.STATISTICS])
        places = {i.content.offset: i.content for i in section if i.opcode == Opcode.METADATA_INDEX}
        self._check(places.keys() == self._metadata.keys(), "metadata indexes")
        for start, index in places.items():
            one = self._metadata.get(start)
            good = one and (one.length, one.content.name) == (index.length, index.name)
            self._check(bool(good), f"metadata index of {start}")
        for one in offsets:
            group = [o for o in section if o.opcode == one.content.group_opcode]
            span = (group[0].start, sum(o.length for o in group)) if group else None
            given = (one.content.group_start, one.content.group_length)
            self._check(span == given, f"summary offset of opcode {one.content.group_opcode}")

    def _chunk_indexes(self, indexes: list[Any]) -> None:
        self._check(
            sorted(i.chunk_start_offset for i in indexes) == sorted(self._chunks), "chunk indexes"
        )
        for index in indexes:
            one = self._chunks.get(index.chunk_start_offset)
            if one is None:
                continue
            chunk = one.content
            given = (
                index.chunk_length, index.message_start_time, index.message_end_time,
                index.compression, index.compressed_size, index.uncompressed_size,
                index.message_index_length, dict(index.message_index_offsets),
            )  # fmt: skip
            true = (
                one.length, chunk.message_start_time, chunk.message_end_time, chunk.compression,
                len(chunk.data), chunk.uncompressed_size, self._index_lengths[one.start],
                self._indexed.get(one.start, {}),
            )  # fmt: skip
            self._check(given == true, f"chunk index of {one.start}: {given}, not {true}")

    def _statistics(self, found: list[Any]) -> None:
        self._check(len(found) == 1, f"{len(found)} statistics")
        for given in found:
            self._check(given.message_count == self.counts.total(), "message_count")
            counted = {k: n for k, n in given.channel_message_counts.items() if n}
            self._check(counted == dict(self.counts), "channel_message_counts")
            self._check(given.channel_count == len(self._channels), "channel_count")
            self._check(given.schema_count == len(self._schemas), "schema_count")
            self._check(given.chunk_count == len(self._chunks), "chunk_count")
            self._check(given.metadata_count == len(self._metadata), "metadata_count")
            self._check(given.attachment_count == 0, "attachment_count")
            if self.counts:
                self._check(given.message_start_time == self._first_ns, "message_start_time")
                self._check(given.message_end_time == self._latest_ns, "message_end_time")
