"""The first pass: the period of the rows, the mean speed, where operating points are."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from motord.importing.column_map import ColumnMap
from motord.importing.mapping import ImportMap, SplitMap
from motord.importing.rows import usable_rows
from motord.importing.source import Problems
from motord.importing.times import hints
from motord.recording.errors import RecordError

GAP_S = 0.5
"""Time without a row that ends a segment, or GAP_ROWS periods if that is longer."""

GAP_ROWS = 20

REGULAR_SHARE = 0.9
"""Share of spacings within half a period of the usual one, from which rows count as regular."""

LEFT_OUT_MAX = 0.5
"""Share of rows that may be left out: with more, the rest is hardly what was recorded."""

Progress = Callable[[float], None]


@dataclass(frozen=True)
class ConstantSegment:
    """Usable rows from `first` to before `end`; turns: how far it turned, negative backwards;
    whole_turns: from zero point to zero point."""

    first: int
    end: int
    turns: float
    whole_turns: int


@dataclass(frozen=True)
class _Begin:
    """Where the open segment begins; row -1 until it has settled."""

    t_ns: int
    row: int = -1
    position: int = 0


class SegmentFinder:
    """Takes usable rows block by block and finds the segments that turn at least once."""

    def __init__(self, split: SplitMap | None, counts: int) -> None:
        self.found: list[ConstantSegment] = []
        self._tolerance = split.tolerance if split else 0.0
        self._settle_ns = round((split.settle_s if split else 0.0) * 1e9)
        self._counts = counts
        self._rows = 0
        self._key: np.ndarray | None = None
        self._begin: _Begin | None = None
        self._last: tuple[int, int] | None = None

    def take(self, t_ns: np.ndarray, position: np.ndarray, keys: np.ndarray, gap_ns: float) -> None:
        """Take rows: t_ns, position (n,); keys (n, k): the values that are constant in a segment.

        gap_ns: time between two rows that ends a segment.
        """
        starts = self._changes(keys)
        last_ns = self._last[0] if self._last else t_ns[0]
        starts |= np.diff(t_ns, prepend=last_ns) > gap_ns
        if self._begin is None:
            starts[0] = True
        bounds = np.flatnonzero(starts).tolist()
        if not bounds or bounds[0] != 0:
            bounds.insert(0, 0)
        for first, end in zip(bounds, [*bounds[1:], t_ns.size], strict=True):
            if starts[first]:
                self._close()
                self._begin = _Begin(int(t_ns[first]) + self._settle_ns)
            self._extend(t_ns, position, first, end)
        self._rows += t_ns.size

    def finish(self) -> list[ConstantSegment]:
        """Return all segments, those that end with the last row too."""
        self._close()
        return self.found

    def _extend(self, t_ns: np.ndarray, position: np.ndarray, first: int, end: int) -> None:
        """Let the open segment go on with rows from `first` to before `end` of the block."""
        begin = self._begin
        if begin is not None and begin.row < 0:
            row = first
            if t_ns[first] < begin.t_ns:
                row += int(np.searchsorted(t_ns[first:end], begin.t_ns))
            if row < end:
                self._begin = _Begin(begin.t_ns, self._rows + row, int(position[row]))
        self._last = int(t_ns[end - 1]), int(position[end - 1])
        self._end = self._rows + end

    def _close(self) -> None:
        """End the open segment, if there is one, and keep it if it turned at least once."""
        begin, last = self._begin, self._last
        if begin is None or last is None or begin.row < 0:
            return
        turned = last[1] - begin.position
        if abs(turned) < self._counts:
            return
        sign = 1 if turned > 0 else -1
        whole = sign * last[1] // self._counts - sign * begin.position // self._counts - 1
        self.found.append(ConstantSegment(begin.row, self._end, turned / self._counts, whole))

    def _changes(self, keys: np.ndarray) -> np.ndarray:
        """Return which rows have other keys than the row before, or than the segment began with."""
        if keys.shape[1] == 0:
            return np.zeros(keys.shape[0], bool)
        if self._tolerance == 0:
            before = np.empty_like(keys)
            before[0] = keys[0] if self._key is None else self._key
            before[1:] = keys[:-1]
            self._key = keys[-1].copy()
            changed = np.zeros(keys.shape[0], bool)
            np.any(keys != before, axis=1, out=changed)
            return changed
        return self._drifts(keys)

    def _drifts(self, keys: np.ndarray) -> np.ndarray:
        changed = np.zeros(keys.shape[0], bool)
        if self._key is None:
            self._key = keys[0].copy()
        row, look = 0, 64
        while row < keys.shape[0]:
            near = (np.abs(keys[row : row + look] - self._key) <= self._tolerance).all(axis=1)
            if near.all():
                row += near.size
                look *= 2
                continue
            row += int(np.argmin(near))
            self._key = keys[row].copy()
            changed[row] = True
            row, look = row + 1, 64
        return changed


@dataclass(frozen=True)
class Survey:
    """rows: that can be used; first_ns, last_ns: their times; period_s: the usual time between two;
    regular: whether it is always about that; counts_per_s: mean speed; segments, in order."""

    rows: int
    first_ns: int
    last_ns: int
    period_s: float
    regular: bool
    counts_per_s: float
    segments: tuple[ConstantSegment, ...]


def survey(column_map: ColumnMap, mapping: ImportMap, few_rows: bool, progress: Progress) -> Survey:
    """Read what must be known before the first row is written. Raises RecordError.

    few_rows: most rows may be left out.
    """
    source, problems = column_map.source, Problems(column_map.source.unit)
    segments = SegmentFinder(mapping.split, column_map.counts)
    medians_ns: list[float] = []
    spacings = usual = rows = travelled = 0
    first_ns = last_ns = last_position = None
    for block in usable_rows(column_map, column_map.by, column_map.by, problems):
        t_ns, position = block.t_ns, block.position
        spacing_ns = np.diff(t_ns, prepend=t_ns[:1] if last_ns is None else [last_ns])
        spacing_ns = spacing_ns[spacing_ns > 0]
        if spacing_ns.size:
            medians_ns.append(float(np.median(spacing_ns)))
            usual += int((np.abs(spacing_ns / medians_ns[-1] - 1) < 0.5).sum())
            spacings += spacing_ns.size
        start = position[:1] if last_position is None else [last_position]
        travelled += int(np.abs(np.diff(position, prepend=start)).sum())
        keys = [_key(name, block.values[name]) for name in column_map.by]
        gap_ns = max(GAP_S * 1e9, GAP_ROWS * float(np.median(medians_ns or [0.0])))
        segments.take(t_ns, position, np.array(keys).T.reshape(t_ns.size, -1), gap_ns)
        first_ns = int(t_ns[0]) if first_ns is None else first_ns
        last_ns, last_position = int(t_ns[-1]), int(position[-1])
        rows += t_ns.size
        progress(block.done)
    if first_ns is None or last_ns is None or not medians_ns:
        raise RecordError(
            f"{source.path}: fewer than two rows in it have {column_map.position_field} and a time "
            "(a number, or a date in ISO form or in that of [csv] date_format) later than the row "
            "before; see that the map names the right columns"
            + "".join(f"; {message}" for message in problems.messages())
        )
    if not few_rows:
        _require_most(column_map, rows, problems)
    return Survey(
        rows=rows,
        first_ns=first_ns,
        last_ns=last_ns,
        period_s=float(np.median(medians_ns)) * 1e-9,
        regular=usual >= REGULAR_SHARE * spacings,
        counts_per_s=travelled / (last_ns - first_ns) * 1e9,
        segments=tuple(segments.finish()),
    )


def _require_most(column_map: ColumnMap, rows: int, problems: Problems) -> None:
    """Raise RecordError if more than `LEFT_OUT_MAX` of all rows are left out; `rows` are used."""
    everything = rows + problems.left_out
    if problems.left_out > LEFT_OUT_MAX * everything:
        why = "; ".join([*problems.messages(), *hints(problems, rows, column_map.position_field)])
        raise RecordError(
            f"{column_map.source.path}: {problems.left_out} of {everything} rows would be left "
            f"out: {why}; see that the rows are in the order of time and the map names the right "
            "columns, or take what is left with --few-rows"
        )


def _key(name: str, values: np.ndarray) -> np.ndarray:
    """Return values that are equal within an operating point; nan outside of any."""
    return np.where(values < 0, np.nan, values) if name == "plan_point" else values
