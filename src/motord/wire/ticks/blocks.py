"""Blocks of fixed-layout records as protobuf messages, encoded and decoded as arrays.

All fields of a record have fixed-width types and all are written, in the order of their numbers,
so every message has the same length and its tags are at the same places: a block of n messages is
an array of n packed rows. google.protobuf reads these messages as any others, and writes the same
bytes but for fields that are zero, which proto3 leaves out.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motord.schema import PROTO_KINDS, Field, Record, record_dtype
from motord.wire.ticks.lanes import Lanes, Place
from motord.wire.ticks.pattern import Bytes, Pattern

Block = NDArray[Any]
"""Structured array, one element a record, with fields of `Record.dtype`."""

_FIXED64, _LEN, _FIXED32 = 1, 2, 5  # protobuf wire types


def varint(value: int) -> bytes:
    """Return `value` (>= 0) in protobuf's variable-length code."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _width(field: Field) -> int:
    return np.dtype(PROTO_KINDS[field.kind]).itemsize


def _tag(field: Field) -> bytes:
    return varint(field.number << 3 | (_FIXED64 if _width(field) == 8 else _FIXED32))


class BlockCodec:
    """Encoder and decoder of the protobuf message of one `Record`.

    `size`: bytes of a message. `pattern`: its constant bytes, the tags; `parts`: what it joins.
    """

    def __init__(self, record: Record) -> None:
        self.record = record
        self._places: list[Place] = []
        self.parts: list[bytes | int] = []
        self.size = 0
        for field in sorted(record.fields, key=lambda f: f.number):
            tag, width = _tag(field), _width(field)
            self._places.append(Place(field.name, self.size, len(tag), width))
            self.parts += [tag, width]
            self.size += len(tag) + width
        self.pattern = Pattern(*self.parts)
        self._all_lanes = Lanes(self._places, record.dtype)
        self._known_dtype = self._all_lanes.dtype
        self._list_head = varint(1 << 3 | _LEN) + varint(self.size)
        self._list_pattern = Pattern(self._list_head, *self.parts)

    def dtype(self, columns: Iterable[str] | None = None) -> np.dtype[np.void]:
        """Return the aligned dtype of `columns`, in that order; all of the record's if None.

        Raises ValueError for a column that the record does not have.
        """
        if columns is None:
            return self._all_lanes.dtype
        kinds = {f.name: PROTO_KINDS[f.kind] for f in self.record.fields}
        names = tuple(dict.fromkeys(columns))
        unknown = [name for name in names if name not in kinds]
        if unknown:
            raise ValueError(
                f"{self.record.name} has no column {', '.join(unknown)}; it has {', '.join(kinds)}"
            )
        return record_dtype([(name, kinds[name]) for name in names])

    def encode(self, block: Block) -> Bytes:
        """Return the messages of `block` (shape (n,)), shape (n, size)."""
        rows = self.pattern.rows(len(block))
        self.fill(rows, block)
        return rows

    def decode(
        self, buffer: bytes | memoryview | Bytes, columns: Iterable[str] | None = None
    ) -> Block:
        """Return the records in `buffer`, whole messages one after the other, shape (n,).

        `columns` chooses fields and their order. Raises ValueError for a buffer that does not
        hold whole messages with the tags of this record, or for an unknown column.
        """
        return self._decode(buffer, self.pattern, columns)

    def encode_list(self, block: Block) -> bytes:
        """Return the message that repeats this one, as in `motord.Ticks`, holding `block`."""
        rows = self._list_pattern.rows(len(block))
        self.fill(rows[:, len(self._list_head) :], block)
        return rows.tobytes()

    def decode_list(self, buffer: bytes | memoryview | Bytes) -> Block:
        """Return the records in a message made by `encode_list`. Raises as `decode` does."""
        return self._decode(buffer, self._list_pattern)

    def fill(self, rows: Bytes, block: Block) -> None:
        """Write the values of `block` (n,) into messages `rows` (n, size) that have their tags."""
        self._all_lanes.pack(self.as_records(block), rows)

    def as_records(self, block: Block) -> Block:
        """Return `block` (n,) with the record's dtype, whatever the order of its fields."""
        if block.dtype is not self._known_dtype:  # to compare all fields takes microseconds
            if block.dtype != self._all_lanes.dtype:
                return _by_name(block, self._all_lanes.dtype)
            self._known_dtype = block.dtype
        return block

    def lanes(self, dtype: np.dtype[np.void]) -> Lanes:
        """Return what reads messages into records of `dtype`, some of this record's fields."""
        return self._all_lanes if dtype == self._all_lanes.dtype else Lanes(self._places, dtype)

    def _decode(
        self,
        buffer: bytes | memoryview | Bytes,
        pattern: Pattern,
        columns: Iterable[str] | None = None,
    ) -> Block:
        raw, name = np.frombuffer(buffer, np.uint8), self.record.name
        if raw.size % pattern.size:
            raise ValueError(f"{raw.size} bytes are not whole {name}s of {pattern.size} bytes each")
        rows = raw.reshape(-1, pattern.size)
        good = pattern.matching(rows)
        if good < len(rows):
            raise ValueError(
                f"message {good} of {len(rows)} is not a {name} as motord writes it: "
                "its field tags differ"
            )
        out = np.empty(len(rows), self.dtype(columns))
        self.lanes(out.dtype).unpack(rows[:, pattern.size - self.size :], out)
        return out


@lru_cache(maxsize=32)
def codec_of(record: Record) -> BlockCodec:
    """Return the codec of a record, the same each time: to make one takes half a millisecond."""
    return BlockCodec(record)


def _by_name(block: Block, dtype: np.dtype[np.void]) -> Block:
    """Return the fields of `block` as `dtype` has them, whatever their order in `block`."""
    out = np.empty(len(block), dtype)
    for name in dtype.names or ():
        out[name] = block[name]
    return out
