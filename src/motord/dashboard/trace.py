"""What a plot shows: a window of the history in buckets, live or at rest."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from motord.dashboard.frames import encode
from motord.dashboard.history import Grid, History
from motord.dashboard.signals import ROW


@dataclass
class View:
    """What a page asked for as view `number`; live until `end_s` is given.

    A live view is sent as a whole once, and then what is new. Buckets begin at multiples of their
    width, whatever the time is, so that they do not flicker; the newest one is sent again until it
    is full.
    """

    number: int
    span_s: float
    buckets: int
    signals: Sequence[str]
    end_s: float | None = None
    _grid: Grid | None = field(default=None, init=False)
    _sent: int = field(default=0, init=False)  # slot after the newest that was sent

    def trace(self, history: History, lost: int) -> bytes | None:
        """Return the message with what the page does not have yet, None if there is nothing."""
        if self.end_s is not None:
            return self._at_rest(history, lost) if self._grid is None else None
        end = history.end
        if end == self._sent:
            return None
        span = int(self.span_s / history.period_s)
        whole = self._grid is None or end - self._sent > span
        if self._grid is None or whole:
            self._grid = history.grid(self.span_s, self.buckets)
            self._sent = end - span
        buckets = range(self._sent // self._grid.slots, -(-end // self._grid.slots))
        self._sent = end
        return self._message(history, self._grid, buckets, lost, whole)

    def again(self) -> None:
        """Send all of it the next time."""
        self._grid = None

    def _at_rest(self, history: History, lost: int) -> bytes:
        assert self.end_s is not None
        begin_s = self.end_s - self.span_s
        self._grid = grid = history.grid(self.span_s, self.buckets, begin_s)
        first, last = (round(t_s / history.period_s) for t_s in (begin_s, self.end_s))
        buckets = range(first // grid.slots, -(-last // grid.slots))
        return self._message(history, grid, buckets, lost, True)

    def _message(
        self, history: History, grid: Grid, buckets: range, lost: int, whole: bool
    ) -> bytes:
        window = history.window(grid, buckets, [ROW[name] for name in self.signals])
        header = {
            "kind": "trace",
            "view": self.number,
            "signals": list(self.signals),
            "live": self.end_s is None,
            "whole": whole,
            "t0_s": window.t0_s,
            "dt_s": window.dt_s,
            "buckets": window.buckets,
            "newest_s": history.end * history.period_s,
            "lost": lost,
        }
        return encode(header, np.stack((window.low, window.high), axis=1))
