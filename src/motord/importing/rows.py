"""The rows of a source that can be used: time rising, position known.

Both passes over a source read it through here, with more or fewer columns, so that row n is the
same one in both.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from motord.importing.column_map import ColumnMap
from motord.importing.forward_fill import ForwardFill
from motord.importing.position import PositionReader
from motord.importing.problems import Problems
from motord.importing.source import RawBlock
from motord.importing.times import REPEATED, STANDING, TimeReader, lacks


@dataclass(frozen=True)
class Rows:
    """n usable rows in a row.

    t_ns (n,): from the zero of the source's clock, or Unix; position (n,): encoder counts, not
    wrapped, whole; turned_rad (n,): the same angle as fine as the source has it; values: of each
    further column (n,), nan where there is none; line (n,); done: share of the source.
    """

    t_ns: np.ndarray
    position: np.ndarray
    turned_rad: np.ndarray
    values: dict[str, np.ndarray]
    line: np.ndarray
    done: float


def usable_rows(
    column_map: ColumnMap, names: tuple[str, ...], held: Collection[str], problems: Problems
) -> Iterator[Rows]:
    """Yield the usable rows with the columns `names` of `column_map`; the others are noted.

    held: of `names`, the columns whose gaps have the value before, also that of a row without a
    position. Raises RecordError for positions that cannot be of this motor.
    """
    reader = _RowReader(column_map, names, held, problems)
    carried: RawBlock | None = None
    for block in column_map.source.blocks(column_map.wanted(names), problems):
        joined = block if carried is None else _join(carried, block)
        use, carried = _cut_last(joined)
        if use.line.size:
            yield from reader.take(use, carried)
    if carried is not None:
        yield from reader.take(carried, None)
    reader.positions.check()


class _RowReader:
    """Takes blocks of rows and yields what is usable of them."""

    def __init__(
        self,
        column_map: ColumnMap,
        names: tuple[str, ...],
        held: Collection[str],
        problems: Problems,
    ) -> None:
        self._column_map, self._names, self._problems = column_map, names, problems
        self._held, self._fill = held, ForwardFill()
        self._before = np.nan
        self._times, self.positions = TimeReader(column_map), PositionReader(column_map)

    def take(self, block: RawBlock, after: RawBlock | None) -> Iterator[Rows]:
        """Yield the usable rows of a block, if there are any; `after` is the row that follows."""
        column_map, problems = self._column_map, self._problems
        t_ns, known, standing = self._times.take(block, after, problems)
        raw = column_map.position(block.columns)
        present = np.isfinite(raw)
        problems.add(lacks(column_map.position_field), block.line[(known | standing) & ~present])
        repeated = standing & (raw == np.concatenate([[self._before], raw[:-1]]))
        self._before = raw[-1] if raw.size else self._before
        problems.add(REPEATED, block.line[repeated])
        problems.add(STANDING, block.line[standing & present & ~repeated])
        timed, known = known | standing, known & present
        values = {name: self._values(name, block, timed, known) for name in self._names}
        if not known.any():
            return
        turned_rad, position = self.positions.take(raw[known])
        yield Rows(t_ns[known], position, turned_rad, values, block.line[known], block.done)

    def _values(
        self, name: str, block: RawBlock, timed: np.ndarray, known: np.ndarray
    ) -> np.ndarray:
        """Return the values of the rows that are `known`; those that hold, also of all `timed`."""
        values = self._column_map.value(name, self._names, block.columns)
        if name not in self._held:
            return np.asarray(values[known])
        lacking = block.line[known & np.isnan(values)]
        self._problems.add(f"no {name}: the value before holds", lacking)
        values[timed] = self._fill.fill(name, values[timed])
        return np.asarray(values[known])


def _join(first: RawBlock, second: RawBlock) -> RawBlock:
    columns = tuple(map(np.concatenate, zip(first.columns, second.columns, strict=True)))
    return RawBlock(columns, np.concatenate([first.line, second.line]), second.done)


def _cut_last(block: RawBlock) -> tuple[RawBlock, RawBlock]:
    """Return a block without its last row, and that row."""
    before, last = (
        RawBlock(tuple(c[part] for c in block.columns), block.line[part], block.done)
        for part in (slice(None, -1), slice(-1, None))
    )
    return before, last
