"""The ticks of captures out of the ring, kept until it is known which capture they are of."""

import threading
from collections.abc import Mapping
from typing import Any

import numpy as np

from motord.schema import TICK_DTYPE, joined, rows_of
from motord.shm.ring import RingReader

READ_AT_ONCE = 1 << 16
KEPT_MAX = 1 << 20
"""Ticks of captures, 176 MB: about two minutes at 8 kHz."""


class CaptureTicks:
    """Follows the ring from the oldest tick that it holds; at most `kept_max` ticks are kept.

    Only ticks of operating points are kept: a plan may pause for an hour. For any thread.
    """

    def __init__(self, ring: RingReader, kept_max: int = KEPT_MAX) -> None:
        self._ring = ring
        self._lock = threading.Lock()
        self._kept_max = kept_max
        self._blocks: list[np.ndarray] = [np.empty(0, TICK_DTYPE)]
        self._kept = 0
        self._after_loss = True  # what came before the first tick is not known
        self._whole_from = 0
        self._newest = -1

    def read(self) -> None:
        """Take in what the ring has."""
        with self._lock:
            while self._ring.backlog:
                block, lost = self._ring.read(READ_AT_ONCE)
                self._after_loss |= lost > 0
                if len(block):
                    self._add(block)

    def of(self, point: Mapping[str, Any]) -> np.ndarray | None:
        """Return the ticks of a capture (`/operating_point`) as far as they are of a point, (n,).

        None if some of them were overwritten before they were read. Those before it are forgotten.
        """
        self.read()
        first, last = int(point["tick_start"]), int(point["tick_end"])
        with self._lock:
            ticks = joined(self._blocks)
            begin, end = np.searchsorted(ticks["tick"], [first, last + 1])
            self._blocks, self._kept = [joined([ticks[end:]])], len(ticks) - int(end)
            whole = self._whole_from <= first and last <= self._newest
        return ticks[begin:end] if whole else None

    def _add(self, block: np.ndarray) -> None:
        if self._after_loss:
            self._whole_from, self._after_loss = int(block["tick"][0]), False
        self._newest = int(block["tick"][-1])
        inside = rows_of(block, block["plan_point"] >= 0)
        self._blocks.append(inside)
        self._kept += len(inside)
        if self._kept > self._kept_max:
            self._blocks, self._kept, self._after_loss = [inside[:0]], 0, True
