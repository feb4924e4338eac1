"""Usable rows as ticks: every field of the tick, from a column, a constant, or what follows."""

import numpy as np

from motord.importing.column_map import ColumnMap
from motord.importing.mapping import IN_OTHER_UNITS
from motord.importing.problems import Problems
from motord.importing.rows import Rows
from motord.importing.speed import SpeedReader, span_s
from motord.importing.survey import Survey
from motord.recording.errors import RecordError
from motord.schema import TICK_DTYPE, Flag

FLOATS = tuple(n for n in TICK_DTYPE.names or () if TICK_DTYPE[n].kind == "f")


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
