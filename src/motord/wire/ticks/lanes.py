"""Fields copied between messages and records, many at a time.

In a message every value follows its tag; in a record the values follow each other. Fields that
are neighbours in both, with tags and values of the same widths, form a lane: values at constant
distances on either side. All of a lane, in all rows, is one copy of a two-dimensional array.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motord.wire.ticks.pattern import ROWS_AT_ONCE, Bytes


@dataclass(frozen=True)
class Place:
    """Where a field is in a message: its tag begins at `offset`, its value is `width` wide."""

    name: str
    offset: int
    tag: int
    width: int


@dataclass(frozen=True)
class _Lane:
    """`count` fields: in a message from byte `offset` on, in a record from `target` on."""

    offset: int
    tag: int
    width: int
    count: int
    target: int

    def continues(self, place: Place, target: int) -> bool:
        return (place.tag, place.width, place.offset, target) == (
            self.tag,
            self.width,
            self.offset + self.count * (self.tag + self.width),
            self.target + self.count * self.width,
        )

    def in_messages(self, rows: Bytes) -> NDArray[Any]:
        """Return the values in `rows` (n, message size), shape (n, count), as a view."""
        step = self.tag + self.width
        fields = rows[:, self.offset : self.offset + self.count * step]
        values = fields.reshape(len(rows), self.count, step)[:, :, self.tag :]
        return values.view(f"<u{self.width}")[:, :, 0]

    def in_records(self, records: Bytes) -> NDArray[Any]:
        """Return the values in `records` (n, record size), shape (n, count), as a view."""
        end = self.target + self.count * self.width
        return records[:, self.target : end].view(f"<u{self.width}")


class Lanes:
    """Copies between messages with fields at `places` and records of `dtype`.

    The fields of `dtype` must be among them; a message may have more.
    """

    def __init__(self, places: Sequence[Place], dtype: np.dtype[np.void]) -> None:
        self.dtype = dtype
        self._lanes: list[_Lane] = []
        for place in places:
            if dtype.fields is not None and place.name in dtype.fields:
                self._add(place, dtype.fields[place.name][1])

    def unpack(self, rows: Bytes, records: NDArray[Any]) -> None:
        """Copy from messages `rows` (n, message size) to contiguous `records` (n,) of `dtype`."""
        target = _as_bytes(records)
        for start in range(0, len(rows), ROWS_AT_ONCE):
            part = slice(start, start + ROWS_AT_ONCE)
            for lane in self._lanes:
                lane.in_records(target[part])[...] = lane.in_messages(rows[part])

    def pack(self, records: NDArray[Any], rows: Bytes) -> None:
        """Copy from `records` (n,) of `dtype` to the values of messages `rows` (n, size)."""
        source = _as_bytes(np.ascontiguousarray(records))
        for start in range(0, len(rows), ROWS_AT_ONCE):
            part = slice(start, start + ROWS_AT_ONCE)
            for lane in self._lanes:
                lane.in_messages(rows[part])[...] = lane.in_records(source[part])

    def _add(self, place: Place, target: int) -> None:
        if self._lanes and self._lanes[-1].continues(place, target):
            last = self._lanes.pop()
            lane = _Lane(last.offset, last.tag, last.width, last.count + 1, last.target)
        else:
            lane = _Lane(place.offset, place.tag, place.width, 1, target)
        self._lanes.append(lane)


def _as_bytes(records: NDArray[Any]) -> Bytes:
    return records.view(np.uint8).reshape(len(records), records.dtype.itemsize)
