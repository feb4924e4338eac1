"""Speed from positions and times: the slope of the last few, which looks back only."""

import numpy as np

from motord.importing.forward_fill import ForwardFill

SPAN_COUNTS = 16
"""Encoder counts that the slope is taken over at the mean speed."""

SPAN_ROWS = 8
"""Rows that it is taken over at least."""

SPAN_S = (0.02, 0.2)
"""Shortest and longest time that it is taken over, if SPAN_ROWS allow."""

PIECE_ROWS = 4096
"""Rows at once: sums over more would lose digits."""


def span_s(period_s: float, counts_per_s: float) -> float:
    """Return the time to take the slope over: it lags by half of it."""
    wanted_s = SPAN_COUNTS / max(counts_per_s, 1e-9)
    return max(min(max(wanted_s, SPAN_S[0]), SPAN_S[1]), SPAN_ROWS * period_s)


class SpeedReader:
    """Least-squares slope over the last `span` seconds of the angle's running median of three.

    The median takes single outliers out. Rows too few for a slope, as after a gap, have the speed
    of the row before.
    """

    def __init__(self, span: float) -> None:
        self._span_ns = round(span * 1e9)
        self._t_ns = np.zeros(0, np.int64)
        self._angle_rad = np.zeros(0)
        self._fill = ForwardFill()

    def take(self, t_ns: np.ndarray, turned_rad: np.ndarray) -> np.ndarray:
        """Return the speed of each row (rad/s); both inputs (n,), the times rising."""
        pieces = [
            self._piece(t_ns[n : n + PIECE_ROWS], turned_rad[n : n + PIECE_ROWS])
            for n in range(0, t_ns.size, PIECE_ROWS)
        ]
        return np.concatenate(pieces)

    def _piece(self, t_ns: np.ndarray, turned_rad: np.ndarray) -> np.ndarray:
        before = self._t_ns.size
        t_ns = np.concatenate([self._t_ns, t_ns])
        angle_rad = np.concatenate([self._angle_rad, turned_rad])
        t_s, smooth_rad = (t_ns - t_ns[0]) * 1e-9, angle_rad - angle_rad[0]
        begin = np.searchsorted(t_ns, t_ns - self._span_ns)
        if angle_rad.size > 2:
            three = np.stack([smooth_rad[:-2], smooth_rad[1:-1], smooth_rad[2:]])
            smooth_rad[2:] = np.median(three, axis=0)
            t_s[2:] = t_s[1:-1].copy()  # which is the median of three times that rise
        slope = _slopes(t_s, smooth_rad, begin)[before:]
        keep = max(int(begin[-1]) - 2, 0)
        self._t_ns, self._angle_rad = t_ns[keep:], angle_rad[keep:]
        filled = self._fill.fill("speed", np.where(np.isfinite(slope), slope, np.nan))
        known = filled[np.isfinite(filled)]
        return np.where(np.isfinite(filled), filled, known[0] if known.size else np.nan)


def _slopes(t_s: np.ndarray, x: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Return the slope of x over t from row `begin` to each row; nan for fewer than 4 rows.

    The mean slope is taken out first, for the sake of digits.
    """
    mean = x[-1] / t_s[-1] if t_s[-1] > 0 else 0.0
    rest = x - mean * t_s
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (t_s, rest, t_s * t_s, t_s * rest)]
    end = np.arange(1, t_s.size + 1)
    t, v, tt, tv = (s[end] - s[begin] for s in sums)
    rows = end - begin
    spread = rows * tt - t * t
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = mean + (rows * tv - t * v) / spread
    return np.where((rows < 4) | (spread <= 0), np.nan, slope)
