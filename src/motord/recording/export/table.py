"""A table that is being exported: its columns, their units, and its rows block by block.

Slow channels are further columns of the ticks: each row has the newest reading of its time.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from motord.recording.plan_columns import PlanValue
from motord.recording.reader import Run
from motord.schema import TICK, Field, Record, joined
from motord.wire.ticks.blocks import Block

TIME = "t_ns"


@dataclass(frozen=True)
class ExportedTable:
    """Rows of a recording; record: what its columns are; metadata: of the recording.

    plan: further columns, the same in all rows.
    """

    dtype: np.dtype[np.void]
    blocks: Iterator[Block]
    record: Record
    metadata: dict[str, Any]
    plan: dict[str, PlanValue]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self.dtype.names or ()

    @property
    def fields(self) -> dict[str, Field]:
        """What is known of each column that the schema has."""
        known = {field.name: field for field in self.record.fields}
        return {name: known[name] for name in self.names if name in known}

    def gathered(self, rows: int) -> Iterator[Block]:
        """Yield blocks of at least `rows` rows, but for the last."""
        waiting: list[Block] = []
        for block in self.blocks:
            waiting.append(block)
            if sum(map(len, waiting)) >= rows:
                yield joined(waiting)
                waiting = []
        if waiting:
            yield joined(waiting)


class HeldChannel:
    """A slow channel at any time: a reading holds until the next, for its `timeout_s` at most."""

    def __init__(self, run: Run, name: str) -> None:
        self.name = name
        self.unit = run.channels()[name].unit
        self._times_ns, self._values = run.channel(name)
        self._timeout_ns = run.channels()[name].timeout_s * 1e9

    def at(self, t_ns: np.ndarray) -> np.ndarray:
        """Return the values at Unix times, shape (n,); nan where there is none."""
        if not len(self._times_ns):
            return np.full(len(t_ns), np.nan)
        before = np.searchsorted(self._times_ns, t_ns, side="right") - 1
        known = before >= 0
        known &= t_ns - self._times_ns[before] <= self._timeout_ns
        return np.where(known, self._values[before], np.nan)


def tick_table(
    run: Run, columns: Iterable[str] | None
) -> tuple[np.dtype[np.void], Iterator[Block], Record]:
    """Return dtype, blocks and fields of the ticks with the slow channels after them.

    Raises RecordError for a column that the recording does not have.
    """
    slow = run.channels()
    wanted = [*run.columns, *slow] if columns is None else list(columns)
    of_ticks = [name for name in wanted if name not in slow]
    held = [HeldChannel(run, name) for name in wanted if name in slow]
    table = run.tick_table
    if not held:
        return table.dtype(of_ticks), table.blocks(of_ticks), TICK
    read = list(dict.fromkeys([*of_ticks, TIME]))
    types = table.dtype(read)
    dtype = np.dtype([(name, "f8" if name in slow else types[name]) for name in wanted])
    fields = [Field(0, one.name, "double", one.unit, "slow channel") for one in held]
    record = replace(TICK, fields=(*TICK.fields, *fields))
    return dtype, _joined(table.blocks(read), dtype, of_ticks, held), record


def _joined(
    blocks: Iterator[Block], dtype: np.dtype[np.void], names: list[str], held: list[HeldChannel]
) -> Iterator[Block]:
    for block in blocks:
        joined = np.empty(len(block), dtype)
        for name in names:
            joined[name] = block[name]
        for channel in held:
            joined[channel.name] = channel.at(block[TIME])
        yield joined
