"""Times of rows as ns that rise from row to row; rows whose times do not are left out."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

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
        self._latest_ns = int(MISSING_NS)
        self._days = _Days()

    def _convert(self, block: RawBlock) -> np.ndarray:
        """Return the times in ns (n,), MISSING_NS for rows without; times of day as they are."""
        clock = self._column_map.clock
        if clock is not None:
            if self._first_row is None:
                self._first_row = int(block.row[0])
            since_ns = np.round((block.row - self._first_row) * (clock.period_s * 1e9))
            return np.asarray(since_ns, np.int64) + (clock.start_ns or 0)
        t = self._column_map.times(block.columns)
        if t.dtype.kind == "i":
            return np.where((t > -FARTHEST_NS) & (t < FARTHEST_NS), t, MISSING_NS)
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
        t_ns = self._convert(block)
        follows_ns = None if after is None else self._convert(after)
        if self._column_map.times_of_day:
            t_ns, self._days = _over_midnight(t_ns, self._days)
            if follows_ns is not None:
                follows_ns, _ = _over_midnight(follows_ns, self._days)
        use = t_ns != MISSING_NS
        problems.add(f"no time{LEFT_OUT}", block.line[~use])
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


@dataclass(frozen=True)
class _Days:
    """The last time of day, in which day from 0 on, and how it followed the one before.

    back: 1 if by more than half a day back, -1 if by more than that ahead, else 0.
    """

    of_day_ns: int = int(MISSING_NS)
    day: int = 0
    back: int = 0


def _over_midnight(t_ns: np.ndarray, before: _Days) -> tuple[np.ndarray, _Days]:
    """Return times of day (n,) that go on: a step back by more than half a day begins another.

    But for one that the next step, or the one before, takes back: that is a time that is wrong; and
    for one of several wrong times within `t_ns`, after which it is no earlier than it was before.
    """
    known = t_ns != MISSING_NS
    of_day_ns = t_ns[known]
    if not of_day_ns.size:
        return t_ns, before
    first_ns = of_day_ns[0] if before.of_day_ns == MISSING_NS else before.of_day_ns
    left_ns = np.concatenate([[first_ns], of_day_ns[:-1]])
    steps_ns = of_day_ns - left_ns
    back = (steps_ns < -DAY_NS // 2).astype(np.int64) - (steps_ns > DAY_NS // 2)
    taken_back = back * np.concatenate([[before.back], back[:-1]]) < 0
    begins = (back > 0).astype(np.int64) - taken_back
    for step, following in pairwise(np.flatnonzero(back)):
        if begins[step] > 0 > back[following] and of_day_ns[following] >= left_ns[step]:
            begins[step], begins[following] = 0, 0
    day = before.day + np.cumsum(begins)
    t_ns = t_ns.copy()
    t_ns[known] += day * DAY_NS
    return t_ns, _Days(int(of_day_ns[-1]), int(day[-1]), int(back[-1]))
