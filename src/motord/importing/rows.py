"""The rows of a source that can be used: time rising, position known.

Both passes over a source read it through here, with more or fewer columns, so that row n is the
same one in both.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from motord.importing.column_map import ColumnMap
from motord.importing.position import PositionReader
from motord.importing.problems import LEFT_OUT, Problems
from motord.importing.source import RawBlock
from motord.importing.times import TimeReader


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
    column_map: ColumnMap, names: tuple[str, ...], problems: Problems
) -> Iterator[Rows]:
    """Yield the usable rows with the columns `names` of `column_map`; the others are noted.

    Raises RecordError for positions that cannot be of this motor.
    """
    times, positions = TimeReader(column_map), PositionReader(column_map)
    carried: RawBlock | None = None
    for block in column_map.source.blocks(column_map.wanted(names), problems):
        joined = block if carried is None else _join(carried, block)
        use, carried = _cut_last(joined)
        if use.line.size:
            yield from _usable(use, carried, times, positions, column_map, names, problems)
    if carried is not None:
        yield from _usable(carried, None, times, positions, column_map, names, problems)
    positions.check()


def _usable(
    block: RawBlock,
    after: RawBlock | None,
    times: TimeReader,
    positions: PositionReader,
    column_map: ColumnMap,
    names: tuple[str, ...],
    problems: Problems,
) -> Iterator[Rows]:
    """Yield the usable rows of a block, if there are any; `after` is the row that follows."""
    t_ns, known = times.take(block, after, problems)
    raw = column_map.position(block.columns)
    present = np.isfinite(raw)
    problems.add(f"no {column_map.position_field}{LEFT_OUT}", block.line[known & ~present])
    known &= present
    if not known.any():
        return
    turned_rad, position = positions.take(raw[known])
    values = {name: column_map.value(name, names, block.columns)[known] for name in names}
    yield Rows(t_ns[known], position, turned_rad, values, block.line[known], block.done)


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
