"""One topic of fixed layout of a recording, as arrays."""

from collections.abc import Iterable, Iterator

import numpy as np

from motord.recording.errors import RecordError
from motord.recording.mcap.chunk_decoder import MessageBlock
from motord.recording.mcap.chunk_source import ALWAYS, ChunkSource, Span
from motord.recording.mcap.compression import CONTENT_MAX_BYTES
from motord.recording.mcap.message_array import MessageArray
from motord.recording.mcap.summary import ChunkEntry
from motord.schema import Record
from motord.wire.ticks.blocks import Block, codec_of
from motord.wire.ticks.lanes import Lanes
from motord.wire.ticks.pattern import Bytes


class Table:
    """The messages of `layout` in `source`; of none, with the columns of `record`, if None."""

    def __init__(self, source: ChunkSource, layout: MessageArray | None, record: Record) -> None:
        self._source = source
        self._layout = layout
        self._codec = codec_of(record) if layout is None else layout.codec

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self._codec.record.dtype.names or ()

    @property
    def present(self) -> bool:
        """True if the recording has this topic, with or without messages."""
        return self._layout is not None

    def dtype(self, columns: Iterable[str] | None = None) -> np.dtype[np.void]:
        """Return the dtype of blocks with these columns. Raises RecordError for an unknown one."""
        try:
            return self._codec.dtype(columns)
        except ValueError as error:
            raise RecordError(f"{self._source.path}: {error}") from error

    def blocks(self, columns: Iterable[str] | None = None, span: Span = ALWAYS) -> Iterator[Block]:
        """Yield the messages within `span` chunk by chunk, shape (n,) with n > 0.

        Raises RecordError for a column that there is not.
        """
        return self._blocks(self.dtype(columns), self._chunks(span), span)

    def last(self, columns: Iterable[str] | None = None) -> Block:
        """Return the last message, shape (1,), or none, shape (0,), reading as little as possible.

        Raises as `blocks` does.
        """
        dtype = self.dtype(columns)
        for chunk in reversed(self._chunks(ALWAYS)):
            for block in self._blocks(dtype, [chunk], ALWAYS):
                return block[-1:]
        return np.empty(0, dtype)

    def whole(self, columns: Iterable[str] | None = None, span: Span = ALWAYS) -> Block:
        """Return all messages within `span`, shape (n,). Raises as `blocks` does."""
        dtype, chunks = self.dtype(columns), self._chunks(span)
        sizes = [chunk.content_size for chunk in chunks]
        message_size = self._layout.size if self._layout else 1
        most = sum(size // message_size for size in sizes if size <= CONTENT_MAX_BYTES)
        out = np.empty(most, dtype)  # what is not used costs nothing
        lanes, count = self._codec.lanes(dtype), 0
        for runs in self._runs(chunks, span):
            missing = count + sum(map(len, runs)) - len(out)
            if missing > 0:  # an index says less than there is
                out = np.concatenate([out, np.empty(missing, dtype)])
            count = _unpack(lanes, runs, out, count)
        return out[:count]

    def _blocks(
        self, dtype: np.dtype[np.void], chunks: Iterable[ChunkEntry], span: Span
    ) -> Iterator[Block]:
        lanes = self._codec.lanes(dtype)
        for runs in self._runs(chunks, span):
            out = np.empty(sum(map(len, runs)), dtype)
            if _unpack(lanes, runs, out, 0):
                yield out

    def _chunks(self, span: Span) -> list[ChunkEntry]:
        if self._layout is None:
            return []
        return list(self._source.chunks(self._layout.channel, span))

    def _runs(self, chunks: Iterable[ChunkEntry], span: Span) -> Iterator[list[Bytes]]:
        """Yield the messages of every chunk within `span`, as they follow each other in it."""
        layout = self._layout
        if layout is None:
            return
        for chunk in self._source.read(chunks):
            yield [
                layout.payloads(_within(layout, part.records, span))
                for part in chunk.messages
                if isinstance(part, MessageBlock) and part.layout is layout
            ]


def _unpack(lanes: Lanes, runs: list[Bytes], out: Block, start: int) -> int:
    """Copy `runs` of messages into `out` from `start` on; return where they end."""
    for messages in runs:
        end = start + len(messages)
        lanes.unpack(messages, out[start:end])
        start = end
    return start


def _within(layout: MessageArray, records: Bytes, span: Span) -> Bytes:
    if span == ALWAYS:
        return records
    chosen = span.contains(layout.times_ns(records).astype(np.int64))
    return records if chosen.all() else records[chosen]
