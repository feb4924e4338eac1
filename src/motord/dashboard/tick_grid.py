"""Ticks on the grid of the history: the slot of each."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from motord.wire.ticks.blocks import Block

ANCHOR_S = 0.2
"""Ticks that are so far from where their counter puts them begin anew: the daemon was restarted."""


@dataclass(frozen=True)
class TickRun:
    """Consecutive ticks: the slot of the first, and the block (n,)."""

    slot: int
    ticks: Block


class TickGrid:
    """Gives ticks at `rate_Hz` their slots; slot 0 is at `epoch_ns` (Unix).

    The counter of the loop's periods places them, so that no jitter of the sample's time moves a
    tick to another slot. After a restart it begins anew at the time of the ticks.
    """

    def __init__(self, rate_Hz: float, epoch_ns: int) -> None:
        self.epoch_ns = epoch_ns
        self._period_ns = 1e9 / rate_Hz
        self._slot_of_tick_0 = 0
        self._end = 0  # slot after the newest

    def runs(self, block: Block) -> Iterator[TickRun]:
        """Yield the ticks of a block (n,) in runs without a gap, in the order of their slots."""
        tick = block["tick"].astype(np.int64)
        restarts = np.flatnonzero(np.diff(tick) <= 0) + 1
        for part in np.split(np.arange(len(block)), restarts):
            if len(part):
                yield from self._without_gaps(block[part[0] : part[-1] + 1], tick[part])

    def _without_gaps(self, block: Block, tick: NDArray[np.int64]) -> Iterator[TickRun]:
        self._anchor(int(block["t_ns"][0]), int(tick[0]))
        edges = [0, *(np.flatnonzero(np.diff(tick) > 1) + 1).tolist(), len(block)]
        for begin, end in pairwise(edges):
            slot = self._slot_of_tick_0 + int(tick[begin])
            yield TickRun(slot, block[begin:end])
            self._end = slot + end - begin

    def _anchor(self, t_ns: int, tick: int) -> None:
        slot_by_time = round((t_ns - self.epoch_ns) / self._period_ns)
        slot = self._slot_of_tick_0 + tick
        if slot < self._end or abs(slot - slot_by_time) * self._period_ns > ANCHOR_S * 1e9:
            self._slot_of_tick_0 = max(slot_by_time, self._end) - tick
