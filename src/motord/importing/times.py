"""Times of rows as ns that rise from row to row; rows whose times do not are left out."""

from collections.abc import Iterator

import numpy as np

from motord.importing.column_map import ColumnMap
from motord.importing.source import LEFT_OUT, MISSING_NS, Problems, RawBlock

STANDING = f"same time as the row before{LEFT_OUT}"
REPEATED = f"same time and position as the row before{LEFT_OUT}"
BACK = f"earlier than a row before{LEFT_OUT}"

MANY_ROWS = 0.1
"""Share of rows with one problem from which its cause is probably in the map or the source."""

DAY_NS = 86_400 * 10**9

FARTHEST_NS = 4 * 10**18
"""Times beyond are none: the year 2096 in Unix time."""


def lacks(field: str) -> str:
    """Return the kind of a row without a field that it needs."""
    return f"no {field}{LEFT_OUT}"


def hints(problems: Problems, rows: int, position: str) -> Iterator[str]:
    """Yield what is probably wrong with the rows, of which so many can be used.

    position: the field that has it.
    """
    if problems.count(STANDING) > MANY_ROWS * rows:
        yield "many times repeat: where they are rounded, give period_s instead of a column"
    if problems.count(REPEATED) > MANY_ROWS * rows:
        yield "many rows repeat time and position: each sample is held for several rows"
    if problems.count(lacks(position)) > MANY_ROWS * rows:
        yield (
            f"many rows have no {position}: where channels are in rows of their own, join them to "
            "one row for each time"
        )
    if problems.count(BACK) > MANY_ROWS * rows:
        yield "time goes back for many rows: recordings that follow each other must be cut apart"


class TimeReader:
    """Reads times block by block and keeps to those that rise."""

    def __init__(self, column_map: ColumnMap) -> None:
        self._column_map = column_map
        self._first_row: int | None = None
        self._base_s: float | None = None
        self._latest_ns = self._last_ns = int(MISSING_NS)

    def _convert(self, block: RawBlock, before_ns: int) -> np.ndarray:
        """Return the times in ns (n,), MISSING_NS for rows without; before_ns: the last one."""
        clock = self._column_map.clock
        if clock is not None:
            if self._first_row is None:
                self._first_row = int(block.row[0])
            since_ns = np.round((block.row - self._first_row) * (clock.period_s * 1e9))
            return np.asarray(since_ns, np.int64) + (clock.start_ns or 0)
        t = self._column_map.times(block.columns)
        if t.dtype.kind == "i":
            t_ns = np.where((t > -FARTHEST_NS) & (t < FARTHEST_NS), t, MISSING_NS)
            return _over_midnight(t_ns, before_ns) if self._column_map.source.times_of_day else t_ns
        if self._column_map.time_field == "t_ns":
            t = t * 1e-9
        known = np.abs(t) < FARTHEST_NS * 1e-9
        if self._base_s is None and known.any():
            self._base_s = float(np.floor(t[known][0]))
        base_s = self._base_s or 0.0
        since_ns = np.round((np.where(known, t, base_s) - base_s) * 1e9).astype(np.int64)
        return np.where(known, since_ns + int(base_s) * 1_000_000_000, MISSING_NS)

    def take(
        self, block: RawBlock, after: RawBlock | None, problems: Problems
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the times (n,), which rows to use (n,), and which have the time before (n,).

        after: the row that follows. Those with the time before are not noted.
        """
        t_ns = self._convert(block, self._last_ns)
        self._last_ns = _last(t_ns, self._last_ns)
        use = t_ns != MISSING_NS
        problems.add(f"no time{LEFT_OUT}", block.line[~use])
        follows_ns = None if after is None else self._convert(after, self._last_ns)
        ahead = self._ahead(t_ns, use, follows_ns)
        problems.add(f"its time is ahead of the rows around it{LEFT_OUT}", block.line[ahead])
        use &= ~ahead
        known = t_ns[use]
        before = np.maximum.accumulate(np.concatenate([[self._latest_ns], known]))
        self._latest_ns = int(before[-1])
        lines = block.line[use]
        problems.add(BACK, lines[known < before[:-1]])
        standing = use.copy()
        standing[use] = known == before[:-1]
        use[use] = known > before[:-1]
        return t_ns, use, standing

    def _ahead(
        self, t_ns: np.ndarray, use: np.ndarray, follows_ns: np.ndarray | None
    ) -> np.ndarray:
        """Return which rows are later than the next, which is itself later than the one before."""
        after = follows_ns if follows_ns is not None else np.array([], np.int64)
        known = np.concatenate([[self._latest_ns], t_ns[use], after[after != MISSING_NS]])
        middle = known[1 : 1 + int(use.sum())]
        follows = np.concatenate([known[2:], np.full(2, np.iinfo(np.int64).max)])[: middle.size]
        ahead = np.zeros(t_ns.size, bool)
        ahead[use] = (follows < middle) & (follows > known[: middle.size])
        return ahead


def _last(t_ns: np.ndarray, before_ns: int) -> int:
    """Return the last time that is known."""
    known = t_ns[t_ns != MISSING_NS]
    return int(known[-1]) if known.size else before_ns


def _over_midnight(t_ns: np.ndarray, before_ns: int) -> np.ndarray:
    """Return times of day (n,) that go on where a day ends: steps of less than half a day."""
    known = t_ns != MISSING_NS
    of_day_ns = t_ns[known]
    if of_day_ns.size:
        first_ns = of_day_ns[0] if before_ns == MISSING_NS else before_ns
        days = np.round(np.diff(of_day_ns, prepend=first_ns) / DAY_NS).astype(np.int64)
        t_ns[known] -= np.cumsum(days) * DAY_NS
    return t_ns
