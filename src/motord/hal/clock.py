"""Whose clock says what: the loop's, the system's, a board's.

`LoopClock` reads, at any moment, the clock in which the loop gives its `now_ns`. `BoardClock` maps
a board's counter to it. What is known of a board's clock are bounds: a sample arrives after it was
taken, a heartbeat is heard after it was sent. Delays vary, their least values hardly: so each
bound is kept as a line below all that was seen in the last seconds, and a late reading, however
late, does not move it. The drift comes from the heartbeats alone: their delay is the link's, while
that of the samples includes the wait until the loop reads, which slides through a whole period as
the two rates slip past each other.
"""

import time

WINDOW_NS = 250_000_000
WINDOWS = 16
DRIFT_MAX = 250e-6
DRIFT_WINDOWS = 4
"""Windows needed before a drift is believed."""
HEARTBEAT_LATENCY_NS = 100_000
"""Half the round trip is taken for the heartbeat's way, but never more than this: what else is in
the round trip is the time until the loop comes round to read."""
INCONSISTENT_NS = 50_000
"""A heartbeat heard before it can have been sent by more than this was stamped wrongly."""
JUMP_NS = 50_000_000
LATE_NS = 1_000_000_000
"""A clock further off than JUMP_NS (behind: for LATE_NS on end) has jumped: start anew."""


class LoopClock:
    """The clock of `now_ns`: the monotonic one plus an offset, learnt from the calls themselves."""

    __slots__ = ("_offset_ns", "_told")

    def __init__(self) -> None:
        self._offset_ns = time.time_ns() - time.monotonic_ns()
        self._told = False

    def tell(self, now_ns: int) -> None:
        """Learn that it was `now_ns` a moment ago: of many moments the shortest counts."""
        offset_ns = now_ns - time.monotonic_ns()
        if offset_ns > self._offset_ns or not self._told:
            self._offset_ns, self._told = offset_ns, True

    def now_ns(self) -> int:
        """Return the loop's time of this moment."""
        return time.monotonic_ns() + self._offset_ns

    def from_system(self, t_ns: int) -> int:
        """Return the loop's time of a Unix time that the kernel or a library stamped."""
        return t_ns - time.time_ns() + time.monotonic_ns() + self._offset_ns


class Bound:
    """A straight line of slope `drift` below all values of the last WINDOWS windows."""

    def __init__(self, t_ns: int, value_ns: int) -> None:
        """Start with a first value at time `t_ns`."""
        self.drift = 0.0
        self._t0_ns, self._v0_ns = t_ns, value_ns
        self._points: list[tuple[int, int]] = []  # the least of each window
        self._window_end_ns = t_ns + WINDOW_NS
        self._least = (0, 0)
        self._level_ns = 0.0

    def at(self, t_ns: int) -> int:
        """Return the line at `t_ns`."""
        return self._v0_ns + round(self._level_ns + self.drift * (t_ns - self._t0_ns))

    def add(self, t_ns: int, value_ns: int) -> bool:
        """Take a value; one below the line lowers it at once. True if a window has just ended."""
        t, value = t_ns - self._t0_ns, value_ns - self._v0_ns
        ended = t_ns >= self._window_end_ns
        if ended:
            self._window_end_ns = t_ns + WINDOW_NS
            self._points.append(self._least)
            del self._points[:-WINDOWS]
            self.lean(self.drift)
        if ended or value - self._least[1] < self.drift * (t - self._least[0]):
            self._least = (t, value)
        self._level_ns = min(self._level_ns, value - self.drift * t)
        return ended

    def lean(self, drift: float) -> None:
        """Give the line the slope `drift` and raise it until it touches a point."""
        self.drift = drift
        points = [*self._points, self._least]
        self._level_ns = min(value - drift * t for t, value in points)

    def fitted_drift(self) -> float:
        """Return the slope that lies closest below the points: that of their lower hull's edge at
        their mean time. 0 while the points are few."""
        if len(self._points) < DRIFT_WINDOWS:
            return 0.0
        left, right = _edge(self._points)
        drift = (right[1] - left[1]) / (right[0] - left[0])
        return min(max(drift, -DRIFT_MAX), DRIFT_MAX)


def _edge(points: list[tuple[int, int]]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the ends of the lower hull's edge at the mean time of `points` (in order of time)."""
    hull: list[tuple[int, int]] = []
    for point in points:
        while len(hull) >= 2 and _turns_right(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    mean = sum(t for t, _ in points) / len(points)
    right = next(n for n in range(1, len(hull)) if hull[n][0] >= mean or n == len(hull) - 1)
    return hull[right - 1], hull[right]


def _turns_right(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int]) -> bool:
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])


class BoardClock:
    """Maps a board's wrapping counter of `unit_ns` steps to the loop's clock.

    Two-way: `received` for every reading of samples, `heartbeat` whenever the board tells when it
    heard one. Without heartbeats a sample's time is late by the least delay until it is read. A
    counter that jumps (a board that was reset) starts the filter anew and is counted in `resets`.
    """

    def __init__(self, unit_ns: int = 1000, modulus: int = 1 << 32) -> None:
        self.resets = 0
        self._unit_ns = unit_ns
        self._modulus = modulus
        self._ticks: int | None = None
        self._board_ns = 0
        self._upper: Bound | None = None
        self._lower: Bound | None = None
        self._late_since_ns: int | None = None

    def reset(self) -> None:
        """Forget the board's clock: the board says that it has started anew."""
        self.resets += 1
        self._forget()

    def received(self, ticks: int, arrival_ns: int) -> int:
        """Return the loop's time of a sample taken at `ticks` and read at `arrival_ns`.

        Feed the newest sample of each reading; never later than `arrival_ns`.
        """
        if self._ticks is not None:
            step = (ticks - self._ticks) % self._modulus
            if step >= self._modulus // 2:
                self.reset()
            else:
                self._board_ns += step * self._unit_ns
                if self._jumped(arrival_ns):
                    self.reset()
        self._ticks = ticks
        difference_ns = arrival_ns - self._board_ns
        if self._upper is None:
            self._upper = Bound(self._board_ns, difference_ns)
        else:
            self._upper.add(self._board_ns, difference_ns)
        return min(self._board_ns + self._difference_ns(), arrival_ns)

    def heartbeat(self, ticks: int, sent_ns: int) -> None:
        """Take that the board heard at `ticks` what was sent at `sent_ns`.

        Ignored before the first sample, from where times are counted, and if it contradicts what
        the samples tell: one wrong stamp would hold for as long as the bound remembers.
        """
        if self._ticks is None or self._upper is None:
            return
        half = self._modulus // 2
        step = (ticks - self._ticks + half) % self._modulus - half
        board_ns = self._board_ns + step * self._unit_ns
        value_ns = board_ns - sent_ns
        if value_ns + self._upper.at(board_ns) < -INCONSISTENT_NS:
            return
        if self._lower is None:
            self._lower = Bound(board_ns, value_ns)
        elif self._lower.add(board_ns, value_ns):
            self._lower.lean(self._lower.fitted_drift())
            self._upper.lean(-self._lower.drift)

    def _difference_ns(self) -> int:
        """Return loop's time minus board's time, at the board's newest sample."""
        assert self._upper is not None
        upper_ns = self._upper.at(self._board_ns)
        if self._lower is None:
            return upper_ns
        round_trip_ns = max(upper_ns + self._lower.at(self._board_ns), 0)
        return upper_ns - round_trip_ns + min(round_trip_ns // 2, HEARTBEAT_LATENCY_NS)

    def _jumped(self, arrival_ns: int) -> bool:
        """Return whether the board's clock is ahead, or behind for long, of what was learnt."""
        late_ns = arrival_ns - self._board_ns - self._difference_ns()
        if late_ns <= JUMP_NS:
            self._late_since_ns = None
            return late_ns < -JUMP_NS
        if self._late_since_ns is None:
            self._late_since_ns = arrival_ns
        return arrival_ns - self._late_since_ns > LATE_NS

    def _forget(self) -> None:
        self._ticks = None
        self._board_ns = 0
        self._upper = self._lower = None
        self._late_since_ns = None
