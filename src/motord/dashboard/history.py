"""The last hour of the signals: minimum and maximum of any window, in a time that its buckets take.

Time is a grid of slots, one for each period of the loop; slot 0 is at time 0. A pyramid of rings
has the values of slots, then minimum and maximum of cells of 16 slots, of 256 slots: the coarser,
the longer. Buckets are whole cells, so what a bucket says is exact: a spike of one tick is in the
minimum or maximum of its bucket at any zoom. A slot without a tick is NaN.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from motord.wire.ticks.blocks import Block

FACTOR = 16
"""Cells of a level in one of the next."""
FINE = 4
"""A bucket has at least so many cells: its width is what was asked for within a quarter."""
RETENTION_S = (60.0, 660.0, 3600.0)
"""How long each level goes back. At 10 kHz a signal takes 6.8 MB."""
BUCKETS_MAX = 8192

Values = NDArray[np.float32]


def period_ns(rate_Hz: float) -> int:
    """Return the loop's period: whole nanoseconds, by which a day at 15 kHz is 0.4 s longer."""
    return round(1e9 / rate_Hz)


@dataclass(frozen=True)
class Window:
    """Minimum and maximum (signals, buckets) in buckets of `dt_s` from `t0_s` on; NaN: no tick."""

    t0_s: float
    dt_s: float
    low: Values
    high: Values

    @property
    def buckets(self) -> int:
        """How many."""
        return int(self.low.shape[1])


@dataclass(frozen=True)
class Grid:
    """Buckets of `slots` slots each, read at `level` of the pyramid; bucket 0 begins at time 0."""

    slots: int
    level: int


class _Level:
    """Minimum and maximum of the newest `capacity` cells of `slots` slots: rings by cell number."""

    def __init__(self, signals: int, slots: int, capacity: int) -> None:
        self.slots = slots
        self._capacity = capacity
        self._low = np.empty((signals, capacity), np.float32)
        self._high = self._low if slots == 1 else np.empty_like(self._low)
        self._begin = self.end = 0

    @property
    def oldest(self) -> int:
        """Number of the oldest cell that is kept."""
        return max(self._begin, self.end - self._capacity)

    def start(self, cell: int) -> None:
        """Begin at `cell`; there is nothing yet."""
        self._begin = self.end = cell

    def skip_to(self, cell: int) -> None:
        """Leave the cells from the end until `cell` empty."""
        at = self._places(max(self.end, cell - self._capacity), cell)
        self._low[:, at] = self._high[:, at] = np.nan
        self.end = max(self.end, cell)

    def write(self, cell: int, low: Values, high: Values) -> None:
        """Put cells (signals, n) from `cell` on in their places."""
        at = self._places(cell, cell + low.shape[1])
        self._low[:, at] = low
        if self._high is not self._low:
            self._high[:, at] = high
        self.end = max(self.end, cell + low.shape[1])

    def read(self, begin: int, end: int, rows: Sequence[int] | slice) -> tuple[Values, Values]:
        """Return minimum and maximum of cells `begin` to `end`, NaN where there is none."""
        cells, at = np.arange(begin, end), self._places(begin, end)
        known = (cells >= self.oldest) & (cells < self.end)
        low = np.where(known, self._low.take(at, 1)[rows], np.nan)
        if self._high is self._low:
            return low, low
        return low, np.where(known, self._high.take(at, 1)[rows], np.nan)

    def covers(self, slot: int) -> bool:
        """Return whether no older cell than that of `slot` was written over."""
        return self.oldest == self._begin or self.oldest * self.slots <= slot

    def _places(self, begin: int, end: int) -> NDArray[np.int64]:
        return np.arange(begin, end) % self._capacity


class History:
    """Rings of `signals` signals at `rate_Hz`. Values come in by slot, in the order of time."""

    def __init__(
        self, signals: int, rate_Hz: float, retention_s: Sequence[float] = RETENTION_S
    ) -> None:
        self.period_s = period_ns(rate_Hz) / 1e9
        self._levels = [
            _Level(signals, slots, FACTOR * max(1, -int(-seconds * rate_Hz // (slots * FACTOR))))
            for slots, seconds in ((FACTOR**k, s) for k, s in enumerate(retention_s))
        ]
        self._empty = True

    @property
    def end(self) -> int:
        """Slot after the newest."""
        return self._levels[0].end

    def append(self, slot: int, values: Values) -> None:
        """Add values (signals, n) of `slot` and those after it; slots left out have no tick."""
        if self._empty:
            self._empty = False
            for level in self._levels:
                level.start(slot // level.slots)
        for level in self._levels:
            level.skip_to(slot // level.slots)
        cell, low, high = slot, values, values
        for level, above in zip(self._levels, [*self._levels[1:], None], strict=True):
            level.write(cell, low, high)
            if above is not None:
                until = -(-(cell + low.shape[1]) // FACTOR)
                cell //= FACTOR
                low, high = level.read(cell * FACTOR, until * FACTOR, slice(None))
                low, high = _reduced(low, high, FACTOR)

    def grid(self, span_s: float, buckets: int, t0_s: float | None = None) -> Grid:
        """Return the buckets that show `span_s` in at most `buckets`, of a window from `t0_s` on.

        Without `t0_s`, of a window that ends now. They are wider only where no level goes back so
        far.
        """
        count = min(max(buckets, 1), BUCKETS_MAX)
        slots = max(1, -int(-span_s // (count * self.period_s)))
        newest_s = self.end * self.period_s
        begin = int((newest_s - span_s if t0_s is None else t0_s) // self.period_s)
        level = 0
        for number, candidate in enumerate(self._levels):
            if candidate.slots * FINE <= slots or not self._levels[level].covers(begin):
                level = number
        cell = self._levels[level].slots
        return Grid(-(-slots // cell) * cell, level)

    def window(self, grid: Grid, buckets: range, rows: Sequence[int]) -> Window:
        """Return consecutive buckets of `grid`, by number, of the signals `rows`."""
        level = self._levels[grid.level]
        cells = grid.slots // level.slots
        begin, end = buckets.start * cells, buckets.stop * cells
        low, high = _reduced(*level.read(begin, end, list(rows)), cells)
        dt_s = grid.slots * self.period_s
        return Window(buckets.start * dt_s, dt_s, low, high)


def _reduced(low: Values, high: Values, cells: int) -> tuple[Values, Values]:
    """Return minimum and maximum of each `cells` cells on end, NaN where all are."""
    if cells == 1:
        return low, high
    shape = (len(low), -1, cells)
    return np.fmin.reduce(low.reshape(shape), axis=2), np.fmax.reduce(high.reshape(shape), axis=2)


ANCHOR_S = 0.2
"""Ticks that are so far from where their counter puts them begin anew: the daemon was restarted."""


@dataclass(frozen=True)
class TickRun:
    """Consecutive ticks: the slot of the first, and the block (n,)."""

    slot: int
    ticks: Block


class TickGrid:
    """Gives ticks at `rate_Hz` their slots; slot 0 is at `epoch_ns` (Unix).

    The counter of the loop's periods places them, so that no jitter of the sample's time moves a
    tick to another slot. After a restart it begins anew at the time of the ticks.
    """

    def __init__(self, rate_Hz: float, epoch_ns: int) -> None:
        self.epoch_ns = epoch_ns
        self._period_ns = period_ns(rate_Hz)
        self._slot_of_tick_0 = 0
        self._end = 0  # slot after the newest

    def runs(self, block: Block) -> Iterator[TickRun]:
        """Yield the ticks of a block (n,) in runs without a gap, in the order of their slots."""
        tick = block["tick"].astype(np.int64)
        restarts = np.flatnonzero(np.diff(tick) <= 0) + 1
        for part in np.split(np.arange(len(block)), restarts):
            if len(part):
                yield from self._without_gaps(block[part[0] : part[-1] + 1], tick[part])

    def _without_gaps(self, block: Block, tick: NDArray[np.int64]) -> Iterator[TickRun]:
        self._anchor(int(block["t_ns"][0]), int(tick[0]))
        edges = [0, *(np.flatnonzero(np.diff(tick) > 1) + 1).tolist(), len(block)]
        for begin, end in pairwise(edges):
            slot = self._slot_of_tick_0 + int(tick[begin])
            yield TickRun(slot, block[begin:end])
            self._end = slot + end - begin

    def _anchor(self, t_ns: int, tick: int) -> None:
        slot_by_time = round((t_ns - self.epoch_ns) / self._period_ns)
        slot = self._slot_of_tick_0 + tick
        if slot < self._end or abs(slot - slot_by_time) * self._period_ns > ANCHOR_S * 1e9:
            self._slot_of_tick_0 = max(slot_by_time, self._end) - tick
