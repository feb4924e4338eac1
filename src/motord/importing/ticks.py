"""Usable rows as ticks: every field of the tick, from a column, a constant, or what follows.

Speed follows from positions and times: the slope of the last few, which looks back only.
"""

import numpy as np

from motord.importing.column_map import ColumnMap
from motord.importing.mapping import IN_OTHER_UNITS
from motord.importing.rows import ForwardFill, Rows
from motord.importing.source import Problems
from motord.importing.survey import Survey
from motord.recording.errors import RecordError
from motord.schema import TICK_DTYPE, Flag

SPAN_COUNTS = 16
"""Encoder counts that the slope is taken over at the mean speed."""

SPAN_ROWS = 8
"""Rows that it is taken over at least."""

SPAN_S = (0.02, 0.2)
"""Shortest and longest time that it is taken over, if SPAN_ROWS allow."""

PIECE_ROWS = 4096
"""Rows at once: sums over more would lose digits."""

FLOATS = tuple(n for n in TICK_DTYPE.names or () if TICK_DTYPE[n].kind == "f")


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


class TickMaker:
    """Makes ticks of rows, block by block. anchor_ns: Unix time of the zero of the rows' times."""

    def __init__(self, column_map: ColumnMap, survey: Survey, anchor_ns: int) -> None:
        self._source, self._column_map = column_map.source, column_map
        self._anchor_ns = anchor_ns
        self._period_ns = survey.period_s * 1e9 if survey.regular else None
        self._starts = np.array([s.first for s in survey.segments], np.int64)
        self._ends = np.array([s.end for s in survey.segments], np.int64)
        self._row = 0
        self._last_ns: int | None = None
        self._last_tick = -1
        self._missed = 0
        self._names = (*column_map.fields, *column_map.constants)
        self.torque_largest_Nm = 0.0
        self._speed: SpeedReader | None = None
        if not {"speed_rad_s", "speed_Hz"} & set(self._names):
            self._speed = SpeedReader(span_s(survey.period_s, survey.counts_per_s))

    def take(self, rows: Rows, problems: Problems) -> np.ndarray:
        """Return the ticks of usable rows (n,)."""
        ticks = np.zeros(rows.t_ns.size, TICK_DTYPE)
        for name in FLOATS:
            ticks[name] = np.nan
        ticks["t_ns"] = rows.t_ns + self._anchor_ns
        ticks["encoder_count"] = rows.position % self._column_map.counts
        ticks["angle_rad"] = np.minimum(rows.turned_rad % (2 * np.pi), np.float32(6.2831850))
        if self._speed is not None:
            ticks["speed_rad_s"] = self._speed.take(rows.t_ns, rows.turned_rad)
        for name, value in self._column_map.constants.items():
            self._put(ticks, name, np.full(ticks.size, value))
        for name in self._column_map.fields:
            values = rows.values[name]
            if name not in self._column_map.held:
                problems.add(f"no {name}: kept as nan", rows.line[np.isnan(values)])
            self._put(ticks, name, values)
        ticks["plan_point"] = self._plan_points(ticks.size)
        self._number(ticks, rows.line)
        self._row += ticks.size
        largest_Nm = np.fmax.reduce(np.abs(ticks["torque_Nm"]))
        self.torque_largest_Nm = float(np.fmax(self.torque_largest_Nm, largest_Nm))
        return ticks

    def _put(self, ticks: np.ndarray, name: str, values: np.ndarray) -> None:
        field = IN_OTHER_UNITS.get(name, name)
        if name in IN_OTHER_UNITS:
            values = values * 2 * np.pi
        if field == "angle_rad":
            values = np.minimum(values % (2 * np.pi), np.float32(6.2831850))
        dtype = TICK_DTYPE[field]
        if dtype.kind != "f":
            limits = np.iinfo(dtype)
            values = np.clip(np.nan_to_num(np.rint(values)), float(limits.min), float(limits.max))
        ticks[field] = values.astype(dtype)

    def _plan_points(self, count: int) -> np.ndarray:
        """Return the index of the operating point of each row, -1 for none (n,)."""
        rows = np.arange(self._row, self._row + count)
        if not self._starts.size:
            return np.full(count, -1)
        index = np.searchsorted(self._starts, rows, side="right") - 1
        return np.where((index >= 0) & (rows < self._ends[index]), index, -1)

    def _number(self, ticks: np.ndarray, line: np.ndarray) -> None:
        """Number the ticks; where rows are regular, those that lack count too."""
        if "tick" in self._names:
            number = ticks["tick"].astype(np.int64)
            rise = np.diff(number, prepend=self._last_tick)
            if (rise < 1).any():
                raise RecordError(
                    f"{self._source.path}: {self._source.unit} {line[np.argmin(rise >= 1)]}: tick "
                    "does not rise there; leave it out of the map, and rows are counted"
                )
            skipped = rise - 1
            skipped[0] *= self._last_ns is not None
        else:
            before_ns = [ticks["t_ns"][0] if self._last_ns is None else self._last_ns]
            spacing_ns = np.diff(ticks["t_ns"], prepend=before_ns)
            skipped = np.zeros(ticks.size, np.int64)
            if self._period_ns is not None:
                skipped = np.maximum(np.rint(spacing_ns / self._period_ns).astype(np.int64) - 1, 0)
            ticks["tick"] = self._last_tick + np.cumsum(skipped + 1)
        if "missed" not in self._names:
            missed = self._missed + np.cumsum(skipped)
            ticks["missed"] = np.minimum(missed, np.iinfo(np.uint32).max)
            ticks["flags"][skipped > 0] |= np.uint32(Flag.AFTER_GAP)
            self._missed = int(missed[-1])
        self._last_tick, self._last_ns = int(ticks["tick"][-1]), int(ticks["t_ns"][-1])
