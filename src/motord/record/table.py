"""One topic of fixed layout of a recording, as arrays."""

from collections.abc import Iterable, Iterator

import numpy as np

from motord.record.compression import CONTENT_MAX_BYTES
from motord.record.content import Rows
from motord.record.errors import RecordError
from motord.record.rows import MessageRows
from motord.record.source import ALWAYS, Source, Span
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
        dtype, layout = self._dtype(columns), self._layout
        if layout is None:
            return
        for parts in self._source.parts(layout.channel, span):
            runs = [p.rows for p in parts if isinstance(p, Rows) and p.layout is layout]
            block = _extract(layout, [_within(layout, rows, span) for rows in runs], dtype)
            if len(block):
                yield block

    def whole(self, columns: Iterable[str] | None = None, span: Span = ALWAYS) -> Block:
        """Return all messages within `span`, shape (n,). Raises as `blocks` does."""
        columns = None if columns is None else tuple(columns)
        out = np.empty(self._most(span), self._dtype(columns))  # what is not used costs nothing
        count = 0
        for block in self.blocks(columns, span):
            out[count : count + len(block)] = block
            count += len(block)
        return out[:count]

    def _dtype(self, columns: Iterable[str] | None) -> np.dtype[np.void]:
        try:
            return self._codec.dtype(columns)
        except ValueError as error:
            raise RecordError(f"{self._source.path}: {error}") from error

    def _most(self, span: Span) -> int:
        """Return how many messages there can be at most."""
        if self._layout is None:
            return 0
        chunks = self._source.chunks(self._layout.channel, span)
        sizes = (chunk.content_size for chunk in chunks)
        return sum(size // self._layout.size for size in sizes if size <= CONTENT_MAX_BYTES)


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
