"""The rows of a source that can be used: time rising, position known.

Positions are encoder counts, or an angle in any range, and become counts that go on and on. Both
passes over a source read it through here, with more or fewer columns, so that row n is the same one
in both.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from motord.importing.column_map import ColumnMap
from motord.importing.source import Problems, RawBlock
from motord.importing.times import REPEATED, STANDING, TimeReader, lacks
from motord.recording.errors import RecordError

JUMPS = 4
"""Jumps through the range, all alike and in one direction, that show that positions wrap."""

ALIKE = 0.95
"""Parts of the range, and of the largest, that such a jump has at least."""

FINE = 0.02
"""Part of the range that the least step is at most where jumps both ways are wraps of a rotor that
turns both ways, not a position that is noise of a few values."""

NARROW = 0.01
"""Part of a turn that such a range has at least: a narrower one is the noise of a rotor that stands
between two counts."""

RANGE = (0.75, 1.02)
"""Range of positions, in parts of a turn, that a source may wrap at."""


class ForwardFill:
    """Fills gaps in columns with the value before, from block to block."""

    def __init__(self) -> None:
        self._last: dict[str, float] = {}

    def fill(self, name: str, values: np.ndarray) -> np.ndarray:
        """Return `values` (n,) with nan replaced; nan stays where there is no value before."""
        if not values.size:
            return values
        known = np.concatenate([[self._last.get(name, np.nan)], values])
        place = np.where(np.isnan(known), 0, np.arange(known.size))
        filled = np.take(known, np.maximum.accumulate(place))[1:]
        self._last[name] = float(filled[-1])
        return filled


class PositionReader:
    """Unwraps positions block by block, whatever range they are wrapped to, if any."""

    def __init__(self, column_map: ColumnMap) -> None:
        self._path = column_map.source.path
        self._field = column_map.position_field
        self._span = float(column_map.position_span)
        self._counts = column_map.counts
        self._last: float | None = None
        self._turns = 0
        self._lowest, self._highest = np.inf, -np.inf
        self._least_step = np.inf
        self._jumps = np.zeros(0)

    def take(self, raw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the angle that goes on (rad) and the encoder counts that go on, whole (n,).

        raw (n,): counts or rad. Between two rows the rotor turns less than half a turn.
        """
        steps = np.diff(raw, prepend=raw[0] if self._last is None else self._last)
        turns = self._turns - np.cumsum(np.round(steps / self._span).astype(np.int64))
        self._last, self._turns = float(raw[-1]), int(turns[-1])
        self._note_range(raw, steps)
        turned = raw + turns * self._span
        position = np.floor(turned * (self._counts / self._span) + 0.5).astype(np.int64)
        return turned * (2 * np.pi / self._span), position

    def check(self) -> None:
        """Raise RecordError if the positions start again after what is not a turn."""
        width = self._highest - self._lowest
        down, up = self._jumps[:JUMPS], self._jumps[-JUMPS:]
        wraps = [
            jumps.size == JUMPS and np.abs(jumps).min() > ALIKE * max(width, np.abs(jumps).max())
            for jumps in (down, up)
        ]
        noisy = self._least_step > FINE * width or width < NARROW * self._span
        if not any(wraps) or (all(wraps) and noisy):
            return
        if RANGE[0] * self._span <= width <= RANGE[1] * self._span:
            return
        of_what = (
            f"the motor file says that a turn has {self._counts} counts"
            if self._field == "encoder_count"
            else "a turn has 6.2832 rad (from degrees: scale = 0.017453292519943295)"
        )
        raise RecordError(
            f"{self._path}: {self._field} goes from {self._lowest:g} to {self._highest:g} "
            f"and starts again, but {of_what}; correct its scale or the motor file"
        )

    def _note_range(self, raw: np.ndarray, steps: np.ndarray) -> None:
        self._lowest = min(self._lowest, float(raw.min()))
        self._highest = max(self._highest, float(raw.max()))
        moved = np.abs(steps[steps != 0])
        self._least_step = min(self._least_step, float(moved.min(initial=np.inf)))
        sorted_steps = np.sort(np.concatenate([self._jumps, steps]))
        self._jumps = np.concatenate([sorted_steps[:JUMPS], sorted_steps[JUMPS:][-JUMPS:]])


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
    row = np.concatenate([first.row, second.row])
    return RawBlock(columns, row, np.concatenate([first.line, second.line]), second.done)


def _cut_last(block: RawBlock) -> tuple[RawBlock, RawBlock]:
    """Return a block without its last row, and that row."""
    before, last = (
        RawBlock(
            tuple(c[part] for c in block.columns), block.row[part], block.line[part], block.done
        )
        for part in (slice(None, -1), slice(-1, None))
    )
    return before, last
