"""Ticks as they come, and what is missing between them."""

from collections.abc import Callable

import numpy as np
import zenoh

from motord.client.subscription import Subscription
from motord.client.tick_losses import LossCounter, TickLosses


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
