"""Ticks as they come, and what is missing between them."""

from typing import NamedTuple

import numpy as np

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


def losses_between(ticks: np.ndarray, missed: np.ndarray) -> TickLosses:
    """Return the losses within a sequence of `tick` and `missed` (shape (n,), n > 0)."""
    steps, skipped = np.diff(ticks.astype(np.int64)), np.diff(missed.astype(np.int64))
    same_loop = (steps > 0) & (skipped >= 0)
    lost = (steps - 1 - skipped)[same_loop]
    return TickLosses(
        lost_ticks=int(np.maximum(lost, 0).sum()),
        missed_ticks=int(skipped[same_loop].sum()),
        restarts=int((~same_loop).sum()),
    )


class TickSubscription(Subscription[np.ndarray]):
    """Blocks of ticks, shape (n,), `schema.TICK_DTYPE`; `losses` up to the block read last.

    What was lost on the way and what was dropped here, because it was not read in time, is counted
    alike.
    """

    losses = TickLosses()
    _last: tuple[int, int] | None = None

    @property
    def lost_ticks(self) -> int:
        """`losses.lost_ticks`."""
        return self.losses.lost_ticks

    def _passed_on(self, item: np.ndarray) -> None:
        if not len(item):
            return
        before = [] if self._last is None else [self._last]
        ticks = np.concatenate([[tick for tick, _ in before], item["tick"].astype(np.int64)])
        missed = np.concatenate([[count for _, count in before], item["missed"].astype(np.int64)])
        found = losses_between(ticks, missed)
        self.losses = TickLosses(*map(sum, zip(self.losses, found, strict=True)))
        self._last = int(item["tick"][-1]), int(item["missed"][-1])
