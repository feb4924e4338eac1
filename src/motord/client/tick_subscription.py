"""Ticks as they come, and what is missing between them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import zenoh
from numpy.typing import NDArray

from motord.client.subscription import Subscription


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


class TickSubscription(Subscription[np.ndarray]):
    """Blocks of ticks, shape (n,), `schema.TICK_DTYPE`; `losses` up to the block read last.

    What was lost on the way and what was dropped here, because it was not read in time, is counted
    alike.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key_expr: str,
        decode: Callable[[bytes], np.ndarray],
        callback: Callable[[np.ndarray], None] | None = None,
        kept: int | None = None,
    ) -> None:
        self._counter = LossCounter()  # the callback's thread counts from now on
        super().__init__(session, key_expr, decode, callback, kept)

    @property
    def losses(self) -> TickLosses:
        """What is missing up to the block that was read last."""
        return self._counter.losses

    @property
    def lost_ticks(self) -> int:
        """`losses.lost_ticks`."""
        return self.losses.lost_ticks

    def _passed_on(self, item: np.ndarray) -> None:
        self._counter.add(item)
