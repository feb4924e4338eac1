"""Minimum and maximum of every tick of the last minute, so that a spike of one tick shows."""

from dataclasses import dataclass

import numpy as np

from motord.schema import rows_of

SPAN_S = 60.0
BUCKET_NS = 100_000_000
BUCKETS = round(SPAN_S * 1e9 / BUCKET_NS)
_SPARE = 100
"""Buckets kept besides, so that the oldest column is whole."""


@dataclass(frozen=True)
class ScreenSignal:
    """A signal of the tick: its field and the factor to the unit that is shown."""

    label: str
    field: str
    unit: str
    factor: float = 1.0


SIGNALS = (
    ScreenSignal("torque", "torque_Nm", "Nm"),
    ScreenSignal("speed", "speed_rad_s", "Hz", 1.0 / (2.0 * np.pi)),
    ScreenSignal("current a", "i_a_A", "A"),
    ScreenSignal("current b", "i_b_A", "A"),
    ScreenSignal("current c", "i_c_A", "A"),
)


class MinMaxHistory:
    """Buckets of `BUCKET_NS`, aligned to Unix time, in a ring; NaN where there was no tick."""

    def __init__(self) -> None:
        self._size = BUCKETS + _SPARE
        self._newest = 0  # number of the newest bucket: t_ns // BUCKET_NS
        self._low = np.full((len(SIGNALS), self._size), np.nan)
        self._high = np.full((len(SIGNALS), self._size), np.nan)

    def add(self, ticks: np.ndarray) -> None:
        """Add a block of ticks, shape (n,); those older than what is kept are left out."""
        buckets = ticks["t_ns"] // BUCKET_NS
        kept = buckets > max(self._newest, int(buckets.max(initial=0))) - self._size
        ticks, buckets = rows_of(ticks, kept), buckets[kept]
        if not len(ticks):
            return
        self._clear_up_to(int(buckets.max()))
        starts = np.flatnonzero(np.diff(buckets, prepend=-1))
        at = buckets[starts] % self._size
        for row, signal in enumerate(SIGNALS):
            values = ticks[signal.field] * signal.factor
            # one bucket may begin twice in a block whose time steps back: ufunc.at takes both
            np.fmin.at(self._low[row], at, np.fmin.reduceat(values, starts))
            np.fmax.at(self._high[row], at, np.fmax.reduceat(values, starts))

    def _clear_up_to(self, bucket: int) -> None:
        new = np.arange(max(self._newest + 1, bucket - self._size + 1), bucket + 1) % self._size
        self._low[:, new] = self._high[:, new] = np.nan
        self._newest = max(self._newest, bucket)

    def columns(self, now_ns: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
        """Return minimum and maximum, each of shape (signals, n), n <= `columns`, the newest last.

        Together the columns are the last `SPAN_S` before `now_ns`. Their edges are multiples of
        their width in Unix time, so a value stays in its column while the picture moves on.
        """
        each, count = column_buckets(columns), column_count(columns)
        end = now_ns // BUCKET_NS // each + 1
        wanted = np.arange((end - count) * each, end * each)
        known = (wanted > self._newest - self._size) & (wanted <= self._newest)
        low = np.where(known, self._low[:, wanted % self._size], np.nan)
        high = np.where(known, self._high[:, wanted % self._size], np.nan)
        shape = (len(SIGNALS), count, each)
        return np.fmin.reduce(low.reshape(shape), 2), np.fmax.reduce(high.reshape(shape), 2)


def column_buckets(columns: int) -> int:
    """Return how many buckets a column is wide if at most `columns` make up the span."""
    return max(1, -(-BUCKETS // max(columns, 1)))


def column_count(columns: int) -> int:
    """Return how many columns make up the span if there may be at most `columns`."""
    return -(-BUCKETS // column_buckets(columns))


def column_of(t_ns: int, now_ns: int, columns: int) -> int | None:
    """Return the column of `MinMaxHistory.columns` that a time falls into, None if into none."""
    each, count = column_buckets(columns), column_count(columns)
    column = count - 1 - (now_ns // BUCKET_NS // each - t_ns // BUCKET_NS // each)
    return int(column) if 0 <= column < count else None
