"""Segments of rows with constant set-points: what becomes operating points."""

from dataclasses import dataclass

import numpy as np

from motord.importing.mapping import SplitMap

GAP_S = 0.5
"""Time without a row that ends a segment, or GAP_ROWS periods if that is longer."""

GAP_ROWS = 20


@dataclass(frozen=True)
class ConstantSegment:
    """Usable rows from `first` to before `end`; turns: how far it turned, whole_turns: from zero
    point to zero point."""

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
        self.found.append(ConstantSegment(begin.row, self._end, abs(turned) / self._counts, whole))

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
