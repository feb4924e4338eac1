"""Ticks that did not come: gaps in `tick` that skipped periods, `missed`, do not explain."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class TickLosses(NamedTuple):
    """What is missing between the first tick that was read and the newest.

    lost_ticks: ticks of the loop that did not come: gaps in `tick` that `missed` does not explain.
    missed_ticks: periods that the loop itself skipped, for which there is no tick.
    restarts: how often the counter began anew, with another loop; what is missing there is unknown.
    """

    lost_ticks: int = 0
    missed_ticks: int = 0
    restarts: int = 0


class LossCounter:
    """Adds up the losses within and between blocks of ticks, in `losses`."""

    def __init__(self) -> None:
        self.losses = TickLosses()
        self._newest: tuple[int, int] | None = None

    def add(self, block: NDArray[Any]) -> None:
        """Take note of the next block, shape (n,), with `tick` and `missed`."""
        if not len(block):
            return
        counters = np.stack([block["tick"].astype(np.int64), block["missed"].astype(np.int64)])
        if self._newest is not None:
            counters = np.insert(counters, 0, self._newest, axis=1)
        steps, skipped = np.diff(counters)
        same_loop = (steps > 0) & (skipped >= 0)
        lost = (steps - 1 - skipped)[same_loop]
        found = TickLosses(
            lost_ticks=int(np.maximum(lost, 0).sum()),
            missed_ticks=int(skipped[same_loop].sum()),
            restarts=int((~same_loop).sum()),
        )
        self.losses = TickLosses(*map(sum, zip(self.losses, found, strict=True)))
        self._newest = int(counters[0, -1]), int(counters[1, -1])
