"""A chunk in the making: its records, and where each message is."""

import struct
from collections.abc import Mapping

import numpy as np
from isal.isal_zlib import crc32
from mcap.opcode import Opcode
from mcap.records import Chunk
from numpy.typing import NDArray

from motord.recording.mcap.compression import Compress
from motord.recording.mcap.message_array import HEAD, MessageArray
from motord.recording.mcap.records import RECORD_HEAD
from motord.wire.ticks.blocks import Block
from motord.wire.ticks.pattern import Bytes

_INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length, channel and size of a message index

CAPACITY_BYTES = 4 << 20
"""A chunk is closed before it holds more, whatever time it spans; one message may be larger."""

Index = NDArray[np.uint64]
"""Log time and offset in the chunk of messages, shape (n, 2)."""


class _Buffer:
    """Bytes one after the other; `used` of them."""

    def __init__(self) -> None:
        self._bytes: Bytes = np.empty(0, np.uint8)
        self.used = 0

    @property
    def content(self) -> Bytes:
        """The bytes in use, valid until the next `reserve`."""
        return self._bytes[: self.used]

    def reserve(self, size: int) -> Bytes:
        """Return the next `size` bytes, to be filled."""
        start, self.used = self.used, self.used + size
        if self.used > len(self._bytes):
            larger = np.empty(2 * self.used, np.uint8)
            larger[:start] = self._bytes[:start]
            self._bytes = larger
        return self._bytes[start : self.used]

    def clear(self) -> None:
        """Start anew; what an exceptionally large chunk took is given back."""
        self.used = 0
        if len(self._bytes) > 2 * CAPACITY_BYTES:
            self._bytes = np.empty(0, np.uint8)


class _PendingBlocks:
    """Blocks of one channel that are still to be encoded; `size`: bytes that they will have."""

    def __init__(self) -> None:
        self.layout: MessageArray | None = None
        self.size = 0
        self._records = _Buffer()  # as bytes: numpy copies fields one by one
        self._times_ns: list[Block] = []
        self._sequence: list[Block] = []

    def add(self, layout: MessageArray, block: Block, times_ns: Block, sequence: Block) -> None:
        """Copy a block; all blocks are of one `layout`."""
        self.layout = layout
        records = np.ascontiguousarray(layout.codec.as_records(block))
        self._records.reserve(records.nbytes)[:] = records.view(np.uint8)
        self.size += len(block) * layout.size
        self._times_ns.append(times_ns.copy())
        self._sequence.append(sequence.copy())

    def take(self, layout: MessageArray) -> tuple[Block, Block, Block]:
        """Return block, times and sequence numbers of all, which are valid until the next `add`."""
        block = self._records.content.view(layout.codec.dtype())
        times_ns, sequence = np.concatenate(self._times_ns), np.concatenate(self._sequence)
        self._records.clear()
        self.size, self._times_ns, self._sequence = 0, [], []
        return block, times_ns, sequence


class ChunkBuilder:
    """Takes messages until `finish` makes a chunk and its message indexes of them."""

    def __init__(self) -> None:
        self._buffer = _Buffer()
        self._pending = _PendingBlocks()
        self._index: dict[int, list[Index]] = {}

    @property
    def empty(self) -> bool:
        """True if there are no messages."""
        return self._buffer.used == self._pending.size == 0

    @property
    def room(self) -> int:
        """Bytes that still fit."""
        return max(0, CAPACITY_BYTES - self._buffer.used - self._pending.size)

    def add_block(
        self, layout: MessageArray, block: Block, times_ns: Block, sequence: Block
    ) -> None:
        """Add `block` (n,) as messages; times and sequence numbers are of shape (n,).

        All are copied; they are encoded later, together with the blocks that follow.
        """
        if layout is not self._pending.layout:
            self._encode()
        self._pending.add(layout, block, times_ns, sequence)

    def add_message(self, channel: int, t_ns: int, sequence: int, payload: bytes) -> None:
        """Add one message."""
        self._encode()
        self._note(channel, np.array([[t_ns, self._buffer.used]], np.uint64))
        length = HEAD.size - RECORD_HEAD.size + len(payload)
        record = HEAD.pack(Opcode.MESSAGE, length, channel, sequence, t_ns, t_ns) + payload
        self._buffer.reserve(len(record))[:] = np.frombuffer(record, np.uint8)

    def finish(self, name: str, compress: Compress) -> tuple[Chunk, dict[int, Index]]:
        """Return the chunk and the index of every channel in it, and start anew.

        `name` is MCAP's of the compression.
        """
        self._encode()
        content = self._buffer.content.data
        index = {channel: np.concatenate(parts) for channel, parts in self._index.items()}
        chunk = make_chunk(content, name, compress(content), index)
        self._buffer.clear()
        self._index = {}
        return chunk, index

    def _encode(self) -> None:
        layout = self._pending.layout
        if layout is None or self._pending.size == 0:
            return
        start, size = self._buffer.used, self._pending.size
        block, times_ns, sequence = self._pending.take(layout)
        layout.fill(self._buffer.reserve(size), block, times_ns, sequence)
        self._note(layout.channel, layout.index(times_ns, start))

    def _note(self, channel: int, index: Index) -> None:
        self._index.setdefault(channel, []).append(index)


def make_chunk(
    content: memoryview, compression: str, compressed: bytes, index: Mapping[int, Index]
) -> Chunk:
    """Return a chunk of `content`, the messages of which are in `index`."""
    times_ns = np.concatenate([entries[:, 0] for entries in index.values()])
    return Chunk(
        compression=compression,
        data=compressed,
        message_start_time=int(times_ns.min()),
        message_end_time=int(times_ns.max()),
        uncompressed_crc=crc32(content),
        uncompressed_size=len(content),
    )


def index_record(channel: int, index: Index) -> bytes:
    """Return the MessageIndex record of a channel; the library packs its entries one by one."""
    head = _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + index.nbytes, channel, index.nbytes)
    return head + index.astype("<u8", copy=False).tobytes()
