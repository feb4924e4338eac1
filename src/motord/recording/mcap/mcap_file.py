"""The MCAP file around the chunks: header, schemas, channels, metadata, summary, footer.

A file is written as `NAME.part` and takes its name when it is whole, so a file that bears its
name is complete, and what a killed writer leaves behind is seen to be unfinished. Nothing is
buffered here: what has been written survives the death of the process.
"""

import errno
import fcntl
import os
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import accumulate
from pathlib import Path

from isal.isal_zlib import crc32
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from motord.atomic_write import sync_folder, why_not_written
from motord.recording.errors import RecordError
from motord.recording.file_names import part_of, require_free
from motord.recording.mcap.chunk_builder import Index, index_record
from motord.recording.mcap.records import MAGIC, serialise


def try_lock(descriptor: int) -> bool:
    """Lock a file until it is closed or the process ends; False if another process has.

    On a file system that knows no locks it counts as locked.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


@cache
def _library() -> str:
    """Return how motord names itself in the files it writes; a file of pip's is read for it."""
    try:
        return f"motord {version('motord')}"
    except PackageNotFoundError:
        return "motord"


class McapFile:
    """An MCAP file in the making. `size`: bytes written.

    Raises RecordError if it cannot be made, exists already, or cannot be written; after a failed
    write the file ends with the last record that was written whole.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._part = part_of(path)
        self.size = 0
        self._crc = 0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunk_indexes = bytearray()  # objects would take ten times as much memory
        self._metadata: list[MetadataIndex] = []
        self._chunks = 0
        self._counts: Counter[int] = Counter()  # messages of each channel
        self._start_ns, self._end_ns = 0, 0
        self._descriptor = self._create()
        try:
            self._write(MAGIC + serialise([Header(profile="", library=_library())]))
        except BaseException:  # an interrupt, too
            self.discard()
            raise

    @property
    def open(self) -> bool:
        """True until the file is finished or abandoned."""
        return self._descriptor >= 0

    def channel(self, schema: Schema | None, channel: Channel) -> None:
        """Declare a channel and its schema, if it has one."""
        if schema is not None and schema.id not in self._schemas:
            self._write(serialise([schema]))
            self._schemas[schema.id] = schema
        self._write(serialise([channel]))
        self._channels[channel.id] = channel
        self._counts[channel.id] = 0

    def metadata(self, name: str, strings: dict[str, str]) -> None:
        """Write a metadata record."""
        record = serialise([Metadata(name=name, metadata=strings)])
        index = MetadataIndex(offset=self.size, length=len(record), name=name)
        self._write(record)
        self._metadata.append(index)

    def chunk(self, chunk: Chunk, index: Mapping[int, Index]) -> None:
        """Write a chunk and the message indexes of its channels."""
        record = serialise([chunk])
        start, end = self.size, self.size + len(record)
        indexes = [index_record(channel, entries) for channel, entries in index.items()]
        offsets = accumulate(map(len, indexes), initial=end)
        self._write(record, b"".join(indexes))
        self._chunk_indexes += serialise(
            [
                ChunkIndex(
                    message_start_time=chunk.message_start_time,
                    message_end_time=chunk.message_end_time,
                    chunk_start_offset=start,
                    chunk_length=len(record),
                    message_index_offsets=dict(zip(index, offsets, strict=False)),
                    message_index_length=self.size - end,
                    compression=chunk.compression,
                    compressed_size=len(chunk.data),
                    uncompressed_size=chunk.uncompressed_size,
                )
            ]
        )
        start_ns = chunk.message_start_time
        self._start_ns = min(self._start_ns, start_ns) if self._chunks else start_ns
        self._end_ns = max(self._end_ns, chunk.message_end_time)
        self._chunks += 1
        self._counts.update({channel: len(entries) for channel, entries in index.items()})

    def sync(self) -> None:
        """Have the disk hold everything written so far, where others can find it."""
        with self._explained():
            os.fsync(self._descriptor)
            self._check_place()

    def finish(self) -> None:
        """Write summary and footer, sync, and give the file its name."""
        self._write(serialise([DataEnd(self._crc)]))
        self._write(self._summary())
        self.sync()
        with self._explained():
            self._part.rename(self.path)
            self.abandon()
            sync_folder(self.path.parent)

    def abandon(self) -> None:
        """Let go of the file as it is, unfinished under its `.part` name. May be called twice."""
        if self.open:
            os.close(self._descriptor)
            self._descriptor = -1

    def discard(self) -> None:
        """Let go of a file in which there is nothing of use, and remove it."""
        self.abandon()
        with suppress(OSError):
            self._part.unlink()

    def _create(self) -> int:
        with self._explained():
            require_free(self.path, self._part)
            self.path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
            descriptor = os.open(self._part, flags, 0o644)
            try_lock(descriptor)
            return descriptor

    def _write(self, *parts: bytes | memoryview) -> None:
        start = self.size
        with self._explained():
            try:
                for part in parts:
                    self._write_all(part)
            except OSError:
                self.size = start
                os.lseek(self._descriptor, start, os.SEEK_SET)
                os.ftruncate(self._descriptor, start)
                raise
        for part in parts:
            self._crc = crc32(part, self._crc)

    def _write_all(self, part: bytes | memoryview) -> None:
        left = memoryview(part)
        while left:
            written = os.write(self._descriptor, left)
            self.size += written
            left = left[written:]

    def _check_place(self) -> None:
        """Raise OSError if the file was removed or moved: what is written to it then is lost."""
        mine, found = os.fstat(self._descriptor), None
        with suppress(FileNotFoundError, NotADirectoryError):
            found = self._part.stat()
        if found is None or (found.st_dev, found.st_ino) != (mine.st_dev, mine.st_ino):
            raise OSError(errno.ESTALE, "it was removed or moved while it was being written")

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Make a RecordError of whatever the disk or the system says."""
        try:
            yield
        except OSError as error:
            raise RecordError(
                f"{self._part}: cannot write it: {why_not_written(self._part, error)}"
            ) from error

    def _summary(self) -> bytes:
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunks,
            message_count=self._counts.total(),
            message_end_time=self._end_ns,
            message_start_time=self._start_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups: list[tuple[Opcode, bytes | bytearray]] = [
            (Opcode.SCHEMA, serialise(self._schemas.values())),
            (Opcode.CHANNEL, serialise(self._channels.values())),
            (Opcode.STATISTICS, serialise([statistics])),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.METADATA_INDEX, serialise(self._metadata)),
        ]
        start, summary = self.size, b""
        offsets: list[SummaryOffset] = []
        for opcode, content in groups:
            if content:
                offsets.append(SummaryOffset(opcode, start + len(summary), len(content)))
            summary += content
        footer = Footer(start, start + len(summary), summary_crc=0)
        summary += serialise([*offsets, footer])[:-4]
        return summary + struct.pack("<I", crc32(summary)) + MAGIC
