"""One topic of fixed layout of a recording, as arrays."""

from collections.abc import Iterable, Iterator

import numpy as np

from motord.record.compression import CONTENT_MAX_BYTES
from motord.record.content import Rows
from motord.record.errors import RecordError
from motord.record.rows import MessageRows
from motord.record.source import ALWAYS, Source, Span
from motord.record.structure import ChunkEntry
from motord.wire.blocks import Block, BlockCodec
from motord.wire.pattern import Bytes


class Table:
    """The messages of `layout` in `source`; of none, with the columns of `codec`, if None."""

    def __init__(self, source: Source, layout: MessageRows | None, codec: BlockCodec) -> None:
        self._source = source
        self._layout = layout
        self._codec = codec if layout is None else layout.codec

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self._codec.record.dtype.names or ()

    @property
    def present(self) -> bool:
        """True if the recording has this topic, with or without messages."""
        return self._layout is not None

    def blocks(self, columns: Iterable[str] | None = None, span: Span = ALWAYS) -> Iterator[Block]:
        """Yield the messages within `span` chunk by chunk, shape (n,) with n > 0.

        Raises RecordError for a column that there is not.
        """
        return self._read(self._chunks(span), self.dtype(columns), span)

    def last(self, columns: Iterable[str] | None = None) -> Block:
        """Return the last message, shape (1,), or none, shape (0,), reading as little as need be.

        Raises as `blocks` does.
        """
        dtype = self.dtype(columns)
        for block in self._read(reversed(self._chunks(ALWAYS)), dtype, ALWAYS):
            return block[-1:]
        return np.empty(0, dtype)

    def whole(self, columns: Iterable[str] | None = None, span: Span = ALWAYS) -> Block:
        """Return all messages within `span`, shape (n,). Raises as `blocks` does."""
        dtype, chunks = self.dtype(columns), self._chunks(span)
        sizes = [chunk.content_size for chunk in chunks]
        row_size = self._layout.size if self._layout else 1
        most = sum(size // row_size for size in sizes if size <= CONTENT_MAX_BYTES)
        out = np.empty(most, dtype)  # what is not used costs nothing
        count = 0
        for block in self._read(chunks, dtype, span):
            out[count : count + len(block)] = block
            count += len(block)
        return out[:count]

    def dtype(self, columns: Iterable[str] | None = None) -> np.dtype[np.void]:
        """Return the dtype of blocks with these columns. Raises RecordError for an unknown one."""
        try:
            return self._codec.dtype(columns)
        except ValueError as error:
            raise RecordError(f"{self._source.path}: {error}") from error

    def _chunks(self, span: Span) -> list[ChunkEntry]:
        if self._layout is None:
            return []
        return list(self._source.chunks(self._layout.channel, span))

    def _read(
        self, chunks: Iterable[ChunkEntry], dtype: np.dtype[np.void], span: Span
    ) -> Iterator[Block]:
        layout = self._layout
        if layout is None:
            return
        for parts in self._source.parts(chunks):
            runs = [p.rows for p in parts if isinstance(p, Rows) and p.layout is layout]
            block = _extract(layout, [_within(layout, rows, span) for rows in runs], dtype)
            if len(block):
                yield block


def _extract(layout: MessageRows, runs: list[Bytes], dtype: np.dtype[np.void]) -> Block:
    out = np.empty(sum(map(len, runs)), dtype)
    start = 0
    for rows in runs:
        layout.extract(rows, out[start : start + len(rows)])
        start += len(rows)
    return out


def _within(layout: MessageRows, rows: Bytes, span: Span) -> Bytes:
    if span == ALWAYS:
        return rows
    held = span.holds(layout.times_ns(rows).astype(np.int64))
    return rows if held.all() else rows[held]
