"""The map file applied to the columns of a source: which column becomes which field of a tick."""

import math
from collections.abc import Sequence

import numpy as np

from motord.importing.mapping import IN_OTHER_UNITS, SET_POINTS, TIME_S, Column, ImportMap, SplitMap
from motord.importing.source import RowClock, RowSource, WantedColumn, find, locate, suggestion
from motord.recording.errors import RecordError
from motord.schema import TICK_DTYPE

LARGEST = 1e30
"""Value beyond which a number is none: single precision ends not far from there."""

TURNS_MAX = 1e9
"""Turns beyond which a position is none."""

NOT_VALUES = (TIME_S, "t_ns")


class ColumnMap:
    """Columns of `source` for `mapping` and an encoder of `counts`.

    time_field: t_s, t_ns, or "" where the time follows from the number of a row (`clock`);
    times_of_day: its times begin anew at midnight.
    position_field: encoder_count or angle_rad. fields: what else becomes a field of a tick; held:
    of these, those whose gaps have the value before; by: names whose values split the recording.
    Raises RecordError for columns that there are not.
    """

    def __init__(self, source: RowSource, mapping: ImportMap, counts: int) -> None:
        self.source = source
        self.constants = dict(mapping.constants)
        self.notes: list[str] = []
        self._columns: dict[str, tuple[int, Column]] = {
            field: (find(source, field, column), column)
            for field, column in mapping.columns.items()
        }
        self.by = self._split_names(mapping.split) if mapping.split else ()
        source.fix_rows([index for index, _ in self._columns.values()])
        self.time_field = next((name for name in NOT_VALUES if name in self._columns), "")
        self.position_field = "encoder_count" if "encoder_count" in self._columns else "angle_rad"
        self.position_span = counts if self.position_field == "encoder_count" else 2 * math.pi
        self.counts = counts
        self.fields = tuple(
            name
            for name in self._columns
            if name not in (*NOT_VALUES, self.position_field) and not name.startswith("column ")
        )
        self.held = tuple(name for name in self.fields if _holds(name))
        self.clock = self._clock(mapping)
        self.time_is_whole = self._time_is_whole()
        self.times_of_day = (
            self.timed and source.times_of_day
            and source.holds_dates(self._columns[self.time_field][0])
        )  # fmt: skip

    def wanted(self, names: Sequence[str]) -> list[WantedColumn]:
        """Return the columns to read: time, where there is one, position, and `names`."""
        time = (
            [WantedColumn(self._columns[self.time_field][0], self.time_is_whole)]
            if self.timed
            else []
        )
        return [*time, *(WantedColumn(self._columns[n][0]) for n in (self.position_field, *names))]

    @property
    def timed(self) -> bool:
        """True if a column has the time."""
        return self.time_field != ""

    def times(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """Return the times of the wanted columns: s, whole ns, or ns (n,)."""
        return columns[0] if self.time_is_whole else self._scaled(self.time_field, columns[0])

    def position(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """Return the positions of the wanted columns, in counts or rad (n,), nan for none."""
        raw = self._scaled(self.position_field, columns[int(self.timed)])
        raw[~(np.abs(raw) < TURNS_MAX * self.position_span)] = np.nan
        return raw

    def value(self, name: str, names: Sequence[str], columns: Sequence[np.ndarray]) -> np.ndarray:
        """Return the values of `name` of the wanted columns (n,), nan for none."""
        value = self._scaled(name, columns[int(self.timed) + 1 + list(names).index(name)])
        value[~(np.abs(value) < LARGEST)] = np.nan
        return value

    def _scaled(self, name: str, values: np.ndarray) -> np.ndarray:
        column = self._columns[name][1]
        scaled = values.astype(float)
        with np.errstate(over="ignore", invalid="ignore"):
            scaled *= column.scale
            scaled += column.offset
        return scaled

    def _clock(self, mapping: ImportMap) -> RowClock | None:
        if self.timed:
            return None
        if mapping.period_s is not None:
            return RowClock(None, mapping.period_s)
        clock = self.source.row_clock([index for index, _ in self._columns.values()])
        if clock is None:
            raise RecordError(
                f"{self.source.path}: no column has the time of its rows; name t_s or t_ns in "
                "[columns], or give period_s, in the map"
            )
        return clock

    def _time_is_whole(self) -> bool:
        if not self.timed:
            return False
        index, column = self._columns[self.time_field]
        if self.source.holds_dates(index):
            if not column.as_it_is:
                raise RecordError(
                    f"{self.source.path}: {self.time_field}: the column holds dates, which take "
                    "no scale or offset"
                )
            return True
        return (
            self.time_field == "t_ns" and column.as_it_is
            and self.source.holds_whole_numbers(index)
        )  # fmt: skip

    def _split_names(self, split: SplitMap) -> tuple[str, ...]:
        """Return the names to split by that vary; a column of its own gets a name of its own."""
        names = []
        for name in split.by:
            if name in self.constants:
                continue
            known = {IN_OTHER_UNITS.get(n, n): n for n in self._columns}
            if IN_OTHER_UNITS.get(name, name) in known:
                names.append(known[IN_OTHER_UNITS.get(name, name)])
                continue
            index = locate(self.source, name)
            if index is not None:
                names.append(name if name in SET_POINTS else f"column {name}")
                self._columns[names[-1]] = (index, Column(column=name))
            elif name in SET_POINTS:
                self.notes.append(f"no column has {name}: it does not split the recording")
            else:
                raise RecordError(
                    f"{self.source.path}: [split] by: {name!r} is neither mapped nor a column"
                    + suggestion(name, self.source.names)
                )
        return tuple(dict.fromkeys(names))


def _holds(name: str) -> bool:
    """Return whether a field holds where it has no value: a set-point, or a whole number."""
    return name in SET_POINTS or TICK_DTYPE[IN_OTHER_UNITS.get(name, name)].kind != "f"
