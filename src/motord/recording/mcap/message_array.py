"""MCAP Message records of one channel with messages of fixed layout, as arrays."""

import struct
from functools import lru_cache
from typing import cast

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from motord.recording.mcap.records import RECORD_HEAD
from motord.schema import Record
from motord.wire.ticks.blocks import Block, BlockCodec, codec_of
from motord.wire.ticks.pattern import Bytes, Pattern

HEAD = struct.Struct("<BQHIQQ")
"""Opcode, length of what follows, channel, sequence, log time and publish time of a message."""

_CONSTANT = struct.Struct("<BQH")


class MessageArray:
    """The Message records of `channel`, whose payloads `codec` makes. `size`: bytes of one."""

    def __init__(self, channel: int, codec: BlockCodec) -> None:
        self.channel = channel
        self.codec = codec
        self.size = HEAD.size + codec.size
        constant = _CONSTANT.pack(Opcode.MESSAGE, self.size - RECORD_HEAD.size, channel)
        variable = HEAD.size - _CONSTANT.size
        self.pattern = Pattern(constant, variable, *codec.parts)
        self._head = np.dtype(
            {
                "names": ["sequence", "log_time", "publish_time"],
                "formats": ["<u4", "<u8", "<u8"],
                "offsets": [_CONSTANT.size, _CONSTANT.size + 4, _CONSTANT.size + 12],
                "itemsize": self.size,
            }
        )

    def fill(self, buffer: Bytes, block: Block, times_ns: Block, sequence: Block) -> None:
        """Write `block` (n,) as records into `buffer`, n times `size` bytes."""
        records = buffer.reshape(-1, self.size)
        records[:] = self.pattern.template
        head = records.view(self._head)[:, 0]
        head["sequence"] = sequence
        head["log_time"] = times_ns
        head["publish_time"] = times_ns
        self.codec.fill(self.payloads(records), block)

    def leading(self, content: Bytes) -> Bytes:
        """Return the records of this channel that `content` starts with, shape (n, size)."""
        whole = len(content) // self.size
        records = content[: whole * self.size].reshape(-1, self.size)
        return records[: self.pattern.matching(records)]

    def times_ns(self, records: Bytes) -> NDArray[np.uint64]:
        """Return the log times of `records` (n, size), shape (n,)."""
        return cast("NDArray[np.uint64]", records.view(self._head)[:, 0]["log_time"])

    def payloads(self, records: Bytes) -> Bytes:
        """Return the messages in `records` (n, size) without their heads, shape (n, codec.size)."""
        return records[:, HEAD.size :]

    def index(self, times_ns: Block, start: int) -> NDArray[np.uint64]:
        """Return log time and offset of n records in a row from offset `start` on, shape (n, 2)."""
        index = np.empty((len(times_ns), 2), np.uint64)
        index[:, 0] = times_ns
        index[:, 1] = np.arange(len(times_ns)) * self.size + start
        return index


@lru_cache(maxsize=32)
def messages_of(channel: int, record: Record) -> MessageArray:
    """Return the messages of `record` in a channel, the same each time, as `codec_of` does."""
    return MessageArray(channel, codec_of(record))
