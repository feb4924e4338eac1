"""Positions of rows: encoder counts, or an angle in any range, as counts that go on and on."""

import numpy as np

from motord.importing.column_map import ColumnMap
from motord.recording.errors import RecordError

JUMPS = 4
"""Jumps through the range, all alike and in one direction, that show that positions wrap."""

ALIKE = 0.95
"""Parts of the range, and of the largest, that such a jump has at least."""

FINE = 0.02
"""Part of the range that the least step is at most where jumps both ways are wraps of a rotor that
turns both ways, not a position that is noise of a few values."""

NARROW = 0.01
"""Part of a turn that such a range has at least: a narrower one is the noise of a rotor that stands
between two counts."""

RANGE = (0.75, 1.02)
"""Range of positions, in parts of a turn, that a source may wrap at."""


class PositionReader:
    """Unwraps positions block by block, whatever range they are wrapped to, if any."""

    def __init__(self, column_map: ColumnMap) -> None:
        self._path = column_map.source.path
        self._field = column_map.position_field
        self._span = float(column_map.position_span)
        self._counts = column_map.counts
        self._last: float | None = None
        self._turns = 0
        self._lowest, self._highest = np.inf, -np.inf
        self._least_step = np.inf
        self._jumps = np.zeros(0)

    def take(self, raw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the angle that goes on (rad) and the encoder counts that go on, whole (n,).

        raw (n,): counts or rad. Between two rows the rotor turns less than half a turn.
        """
        steps = np.diff(raw, prepend=raw[0] if self._last is None else self._last)
        turns = self._turns - np.cumsum(np.round(steps / self._span).astype(np.int64))
        self._last, self._turns = float(raw[-1]), int(turns[-1])
        self._note_range(raw, steps)
        turned = raw + turns * self._span
        position = np.floor(turned * (self._counts / self._span) + 0.5).astype(np.int64)
        return turned * (2 * np.pi / self._span), position

    def check(self) -> None:
        """Raise RecordError if the positions start again after what is not a turn."""
        width = self._highest - self._lowest
        down, up = self._jumps[:JUMPS], self._jumps[-JUMPS:]
        wraps = [
            jumps.size == JUMPS and np.abs(jumps).min() > ALIKE * max(width, np.abs(jumps).max())
            for jumps in (down, up)
        ]
        noisy = self._least_step > FINE * width or width < NARROW * self._span
        if not any(wraps) or (all(wraps) and noisy):
            return
        if RANGE[0] * self._span <= width <= RANGE[1] * self._span:
            return
        of_what = (
            f"the motor file says that a turn has {self._counts} counts"
            if self._field == "encoder_count"
            else "a turn has 6.2832 rad (from degrees: scale = 0.017453292519943295)"
        )
        raise RecordError(
            f"{self._path}: {self._field} goes from {self._lowest:g} to {self._highest:g} "
            f"and starts again, but {of_what}; correct its scale or the motor file"
        )

    def _note_range(self, raw: np.ndarray, steps: np.ndarray) -> None:
        self._lowest = min(self._lowest, float(raw.min()))
        self._highest = max(self._highest, float(raw.max()))
        moved = np.abs(steps[steps != 0])
        self._least_step = min(self._least_step, float(moved.min(initial=np.inf)))
        sorted_steps = np.sort(np.concatenate([self._jumps, steps]))
        self._jumps = np.concatenate([sorted_steps[:JUMPS], sorted_steps[JUMPS:][-JUMPS:]])
