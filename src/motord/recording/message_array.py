"""MCAP Message records of one channel with messages of fixed layout, as arrays."""

import struct
from typing import cast

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from motord.wire.ticks.blocks import Block, BlockCodec
from motord.wire.ticks.pattern import Bytes, Pattern

HEAD = struct.Struct("<BQHIQQ")
"""Opcode, length of what follows, channel, sequence, log time and publish time of a message."""

RECORD_HEAD = struct.Struct("<BQ")
"""Opcode and length of any record."""

_CONSTANT = struct.Struct("<BQH")


class MessageRows:
    """The Message records of `channel`, whose payloads `codec` makes. `size`: bytes of one."""

    def __init__(self, channel: int, codec: BlockCodec) -> None:
        self.channel = channel
        self.codec = codec
        self.size = HEAD.size + codec.size
        constant = _CONSTANT.pack(Opcode.MESSAGE, self.size - RECORD_HEAD.size, channel)
        variable = HEAD.size - _CONSTANT.size
        self.pattern = Pattern.fixed(constant) + Pattern.free(variable) + codec.pattern
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
        rows = buffer.reshape(-1, self.size)
        rows[:] = self.pattern.template
        head = rows.view(self._head)[:, 0]
        head["sequence"] = sequence
        head["log_time"] = times_ns
        head["publish_time"] = times_ns
        self.codec.fill(self.payloads(rows), block)

    def run(self, content: Bytes) -> Bytes:
        """Return the records of this channel that `content` starts with, shape (n, size)."""
        whole = len(content) // self.size
        rows = content[: whole * self.size].reshape(-1, self.size)
        return rows[: self.pattern.matching(rows)]

    def times_ns(self, rows: Bytes) -> NDArray[np.uint64]:
        """Return the log times of `rows` (n, size), shape (n,)."""
        return cast("NDArray[np.uint64]", rows.view(self._head)[:, 0]["log_time"])

    def payloads(self, rows: Bytes) -> Bytes:
        """Return the messages in `rows` (n, size) without their heads, shape (n, codec.size)."""
        return rows[:, HEAD.size :]
