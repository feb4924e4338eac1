"""Ticks for viewers: the last of each interval, and the extremes of every signal within it."""

from typing import NamedTuple

import numpy as np
from google.protobuf import descriptor_pb2

from motord.client.subscription import LossCounter
from motord.schema import TICK, TICK_DTYPE, joined
from motord.wire.ticks.blocks import Block, BlockCodec, varint
from motord.wire.ticks.proto_text import descriptor_set

EXTREMES_NAME = "motord.TickExtremes"
_BITS = frozenset({"encoder_gray", "trip_bits", "flags", "inverter_status", "bridge_status"})
"""Words of bits: their minimum is what was set in every tick, their maximum what was in any."""
_HEAD = ("t_ns", "t_start_ns", "ticks", "lost")
_CODEC = BlockCodec(TICK)
_FIXED64, _LEN = 1, 2  # protobuf wire types


class Decimated(NamedTuple):
    """Whole intervals: the last tick of each (n,), minima (n,), maxima (n,), and counts (n, 4).

    The columns of `counts` (int64) are `t_ns` and `t_start_ns` (last and first tick of the
    interval), `ticks` in it, and `lost`: those that the loop made and that did not arrive, in all.
    """

    ticks: Block
    minima: Block
    maxima: Block
    counts: Block

    def messages(self) -> tuple[list[bytes], list[bytes]]:
        """Return the messages `motord.Tick` and `motord.TickExtremes` of the intervals."""
        ticks, minima, maxima = (
            [row.tobytes() for row in _CODEC.encode(block)]
            for block in (self.ticks, self.minima, self.maxima)
        )
        return ticks, list(map(_extremes_message, self.counts.tolist(), minima, maxima))


def _extremes_message(counts: list[int], low: bytes, high: bytes) -> bytes:
    head = b"".join(
        varint(number << 3 | _FIXED64) + value.to_bytes(8, "little", signed=True)
        for number, value in enumerate(counts, start=1)
    )
    size = varint(len(low))
    return head + varint(5 << 3 | _LEN) + size + low + varint(6 << 3 | _LEN) + size + high


class Decimator:
    """Decimates blocks of ticks to intervals of `periods` periods of the loop.

    An interval is complete when a tick of another one has arrived. Ticks are counted, not timed:
    without samples of the bridge all have the time of the last one.
    """

    def __init__(self, periods: int) -> None:
        self._counter = LossCounter()
        self._periods = periods
        self._pending = np.empty(0, TICK_DTYPE)

    @property
    def lost(self) -> int:
        """Ticks that the loop made and that did not arrive."""
        return self._counter.losses.lost_ticks

    def take(self, block: Block) -> Decimated:
        """Return the intervals that `block` (shape (n,), `TICK_DTYPE`) completes."""
        self._counter.add(block)
        ticks = joined([self._pending, block])
        interval = ticks["tick"].astype(np.int64) // self._periods
        starts = np.flatnonzero(np.diff(interval, prepend=-1))
        complete = starts[:-1]
        end = int(starts[-1]) if len(starts) else 0
        self._pending = ticks[end:]
        whole = ticks[:end]
        last = starts[1:] - 1
        counts = np.empty((len(complete), len(_HEAD)), np.int64)
        counts[:, 0], counts[:, 1] = whole["t_ns"][last], whole["t_ns"][complete]
        counts[:, 2], counts[:, 3] = starts[1:] - complete, self.lost
        return Decimated(whole[last], *_extremes(whole, complete), counts)

    def skip(self, block: Block) -> None:
        """Pass over `block`, and what is pending: nobody looks."""
        self._counter.add(block)
        self._pending = block[:0]


def _extremes(ticks: Block, starts: Block) -> tuple[Block, Block]:
    minima, maxima = (np.empty(len(starts), TICK_DTYPE) for _ in range(2))
    if len(starts):
        for field in TICK.fields:
            bits = field.name in _BITS
            low, high = (np.bitwise_and, np.bitwise_or) if bits else (np.fmin, np.fmax)
            minima[field.name] = low.reduceat(ticks[field.name], starts)
            maxima[field.name] = high.reduceat(ticks[field.name], starts)
    return minima, maxima


def extremes_descriptor_set() -> bytes:
    """Return the FileDescriptorSet of `motord.TickExtremes`."""
    files = descriptor_pb2.FileDescriptorSet.FromString(descriptor_set(TICK))
    label = descriptor_pb2.FieldDescriptorProto.LABEL_OPTIONAL
    file = files.file.add(
        name="motord/tick_extremes.proto", package="motord", syntax="proto3",
        dependency=[files.file[0].name],
    )  # fmt: skip
    message = file.message_type.add(name=EXTREMES_NAME.partition(".")[2])
    for number, name in enumerate(_HEAD, start=1):
        kind = descriptor_pb2.FieldDescriptorProto.TYPE_SFIXED64
        message.field.add(name=name, number=number, type=kind, label=label)
    for number, name in ((5, "min"), (6, "max")):
        kind = descriptor_pb2.FieldDescriptorProto.TYPE_MESSAGE
        message.field.add(
            name=name, number=number, type=kind, type_name=".motord.Tick", label=label
        )
    return bytes(files.SerializeToString())
