"""A chunk in the making: its records, and where each message is."""

import struct

import numpy as np
from isal.isal_zlib import crc32
from mcap.opcode import Opcode
from mcap.records import ChunkIndex
from numpy.typing import NDArray

from motord.recording.compression import Compress
from motord.recording.message_array import HEAD, RECORD_HEAD, MessageRows
from motord.wire.ticks.blocks import Block
from motord.wire.ticks.pattern import Bytes

CAPACITY_BYTES = 4 << 20
"""A chunk is closed before it holds more, whatever time it spans; one message may be larger."""

CHUNK_HEAD = struct.Struct("<BQQQQII")
"""Opcode, length, first and last time, size and CRC of the content, length of the compression."""

_INDEX_HEAD = struct.Struct("<BQHI")

Index = NDArray[np.uint64]
"""Log time and offset in the chunk of messages, shape (n, 2)."""


class _Waiting:
    """Blocks of one channel that are still to be encoded; `size`: bytes that they will have."""

    def __init__(self) -> None:
        self.rows: MessageRows | None = None
        self.size = 0
        self._records: Bytes = np.empty(0, np.uint8)  # as bytes: numpy copies fields one by one
        self._used = 0
        self._times_ns: list[Block] = []
        self._sequence: list[Block] = []

    def add(self, block: Block, times_ns: Block, sequence: Block) -> None:
        """Copy a block of the dtype of `rows`."""
        assert self.rows is not None
        end = self._used + block.nbytes
        if end > len(self._records):
            larger = np.empty(2 * end, np.uint8)
            larger[: self._used] = self._records[: self._used]
            self._records = larger
        self._records[self._used : end] = np.ascontiguousarray(block).view(np.uint8)
        self._used = end
        self.size += len(block) * self.rows.size
        self._times_ns.append(times_ns.copy())
        self._sequence.append(sequence.copy())

    def take(self) -> tuple[Block, Block, Block]:
        """Return block, times and sequence numbers of all, which are valid until the next `add`."""
        assert self.rows is not None
        block = self._records[: self._used].view(self.rows.codec.dtype())
        times_ns, sequence = np.concatenate(self._times_ns), np.concatenate(self._sequence)
        self.size = self._used = 0
        self._times_ns, self._sequence = [], []
        return block, times_ns, sequence


class ChunkBuilder:
    """Takes messages until `finish` makes a chunk and its message indexes of them."""

    def __init__(self) -> None:
        self._buffer: Bytes = np.empty(CAPACITY_BYTES, np.uint8)
        self._used = 0
        self._waiting = _Waiting()
        self._index: dict[int, list[Index]] = {}

    @property
    def empty(self) -> bool:
        """True if there are no messages."""
        return self._used == self._waiting.size == 0

    @property
    def room(self) -> int:
        """Bytes that still fit."""
        return max(0, CAPACITY_BYTES - self._used - self._waiting.size)

    def add_rows(self, rows: MessageRows, block: Block, times_ns: Block, sequence: Block) -> None:
        """Add `block` (n,) as messages; times and sequence numbers are of shape (n,).

        All are copied; they are encoded later, together with the blocks that follow.
        """
        if rows is not self._waiting.rows:
            self._encode()
            self._waiting.rows = rows
        self._waiting.add(rows.codec.as_records(block), times_ns, sequence)

    def add_message(self, channel: int, t_ns: int, sequence: int, payload: bytes) -> None:
        """Add one message."""
        self._encode()
        index = np.array([[t_ns, self._used]], np.uint64)
        length = HEAD.size - RECORD_HEAD.size + len(payload)
        head = HEAD.pack(Opcode.MESSAGE, length, channel, sequence, t_ns, t_ns)
        record = np.frombuffer(head + payload, np.uint8)
        self._reserve(len(record))[:] = record
        self._index.setdefault(channel, []).append(index)

    def finish(self, name: str, compress: Compress) -> tuple[bytes, dict[int, Index]]:
        """Return the chunk record and the index of every channel in it, and start anew.

        `name` is MCAP's of the compression.
        """
        self._encode()
        content = self._buffer[: self._used].data
        index = {channel: np.concatenate(parts) for channel, parts in self._index.items()}
        times = np.concatenate([entries[:, 0] for entries in index.values()])
        record = chunk_record(content, name, compress(content), int(times.min()), int(times.max()))
        self._used = 0
        self._index = {}
        if len(self._buffer) > CAPACITY_BYTES:
            self._buffer = np.empty(CAPACITY_BYTES, np.uint8)
        return record, index

    def _encode(self) -> None:
        rows = self._waiting.rows
        if rows is None or self._waiting.size == 0:
            return
        block, times_ns, sequence = self._waiting.take()
        start, size = self._used, len(block) * rows.size
        rows.fill(self._reserve(size), block, times_ns, sequence)
        index = np.empty((len(block), 2), np.uint64)
        index[:, 0] = times_ns
        index[:, 1] = np.arange(start, start + size, rows.size)
        self._index.setdefault(rows.channel, []).append(index)

    def _reserve(self, size: int) -> Bytes:
        end = self._used + size
        if end > len(self._buffer):
            larger = np.empty(end, np.uint8)
            larger[: self._used] = self._buffer[: self._used]
            self._buffer = larger
        place = self._buffer[self._used : end]
        self._used = end
        return place


def chunk_record(
    content: memoryview, name: str, compressed: bytes, start_ns: int, end_ns: int
) -> bytes:
    """Return a whole Chunk record; `name` is MCAP's of the compression."""
    label = name.encode()
    length = CHUNK_HEAD.size - RECORD_HEAD.size + len(label) + 8 + len(compressed)
    head = CHUNK_HEAD.pack(
        Opcode.CHUNK, length, start_ns, end_ns, len(content), crc32(content), len(label)
    )
    return b"".join((head, label, struct.pack("<Q", len(compressed)), compressed))


def index_records(
    offset: int, chunk: bytes | memoryview, index: dict[int, Index]
) -> tuple[bytes, ChunkIndex]:
    """Return the message indexes of `chunk`, a record at `offset` of the file, and its entry."""
    places: dict[int, int] = {}
    records: list[bytes] = []
    length = 0
    for channel, entries in index.items():
        places[channel] = offset + len(chunk) + length
        size = entries.nbytes
        records.append(_INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size))
        records.append(entries.astype("<u8", copy=False).tobytes())
        length += _INDEX_HEAD.size + size
    _, _, start_ns, end_ns, content_size, _, label = CHUNK_HEAD.unpack_from(chunk)
    name = bytes(chunk[CHUNK_HEAD.size : CHUNK_HEAD.size + label]).decode()
    entry = ChunkIndex(
        message_start_time=start_ns,
        message_end_time=end_ns,
        chunk_start_offset=offset,
        chunk_length=len(chunk),
        message_index_offsets=places,
        message_index_length=length,
        compression=name,
        compressed_size=len(chunk) - CHUNK_HEAD.size - label - 8,
        uncompressed_size=content_size,
    )
    return b"".join(records), entry
