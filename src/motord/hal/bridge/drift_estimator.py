"""Lines through the least of noisy values: what `hal.bridge.clock` knows of a board's clock.

Time is cut into windows, of which the least value each is kept; a line lies along these. So what
comes late now and then, however late, leaves no trace.
"""

from statistics import median

WINDOW_NS = 250_000_000
WINDOWS = 16
DRIFT_MAX = 250e-6
"""Largest slope believed: two crystals differ by less."""
DRIFT_WINDOWS = 8
"""Windows needed before a drift is believed: of fewer, on a computer that stalls, a late one or two
make a slope that takes ten seconds to forget."""
DRIFT_WEIGHT = 0.1
"""Weight of each new fit of the drift: a drift changes within minutes, with temperature."""


class _Windows:
    """The least values of the last WINDOWS windows, and a line of slope `drift` along them."""

    def __init__(self, t_ns: int, value_ns: int) -> None:
        """Start with a first value at time `t_ns`."""
        self.drift = 0.0
        self._t0_ns, self._v0_ns = t_ns, value_ns
        self._points: list[tuple[int, int]] = []
        self._least = (0, 0)
        self._window_end_ns = t_ns + WINDOW_NS
        self._level_ns = 0.0

    def at(self, t_ns: int) -> int:
        """Return the line at `t_ns`."""
        return self._v0_ns + round(self._level_ns + self.drift * (t_ns - self._t0_ns))

    def _collect(self, t: int, value: int) -> bool:
        """Take a value into its window; return whether a window has just ended."""
        ended = self._t0_ns + t >= self._window_end_ns
        if ended:
            self._window_end_ns = self._t0_ns + t + WINDOW_NS
            self._points.append(self._least)
            del self._points[:-WINDOWS]
        if ended or value - self._least[1] < self.drift * (t - self._least[0]):
            self._least = (t, value)
        return ended


class SampleBound(_Windows):
    """A line of given slope below all values of the last windows, and touching one."""

    def add(self, t_ns: int, value_ns: int) -> None:
        """Take a value; one below the line lowers it at once."""
        t, value = t_ns - self._t0_ns, value_ns - self._v0_ns
        if self._collect(t, value):
            self.lean(self.drift)
        self._level_ns = min(self._level_ns, value - self.drift * t)

    def lean(self, drift: float) -> None:
        """Give the line the slope `drift`, as high as the points allow."""
        self.drift = drift
        points = [*self._points, self._least]
        self._level_ns = min(value - drift * t for t, value in points)


class HeartbeatLine(_Windows):
    """A line with the board's drift, below all values of the last windows.

    The drift is the median slope between any two windows (Theil and Sen), smoothed: windows
    without one prompt heartbeat may be many on a busy computer.
    """

    _fits = 0

    def add(self, t_ns: int, value_ns: int) -> bool:
        """Take a value; return whether the line has changed."""
        if not self._collect(t_ns - self._t0_ns, value_ns - self._v0_ns):
            if not self._points:
                self._level_ns = self._least[1]
            return False
        points = self._points
        if len(points) >= DRIFT_WINDOWS:
            slope = median(
                (b[1] - a[1]) / (b[0] - a[0])
                for place, b in enumerate(points)
                for a in points[:place]
            )
            self._fits += 1
            weight = max(DRIFT_WEIGHT, 1 / self._fits)
            self.drift += weight * (min(max(slope, -DRIFT_MAX), DRIFT_MAX) - self.drift)
        self._level_ns = min(value - self.drift * t for t, value in points)
        return True
