"""Subscriptions to the keys of a daemon; of ticks, what is missing between them."""

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, Generic, NamedTuple, Self, TypeVar

import numpy as np
import zenoh
from numpy.typing import NDArray

from motord.api.messages import BenchState
from motord.api.plan_messages import PlanView
from motord.client.error import ClientError

KEPT = 1000
CLOSE_S = 2.0
"""How long the end of a subscription waits for a callback under way."""

_Item = TypeVar("_Item")
_Document = TypeVar("_Document", bound=BenchState | PlanView)
_log = logging.getLogger("motord")


class Subscription(Generic[_Item]):
    """Items of one key: passed to a callback, or queued for `get` and iteration.

    At most `kept` items wait; older ones are dropped and counted in `lost`, so that a subscriber
    that stands still costs no more than that. Malformed items are dropped and counted in
    `malformed`; the first is logged. The callback runs in a thread of its own. Raises ClientError
    if the connection is over.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key_expr: str,
        decode: Callable[[bytes], _Item],
        callback: Callable[[_Item], None] | None = None,
        kept: int | None = None,
    ) -> None:
        self.lost = self.malformed = 0
        self.on_item: Callable[[], None] = lambda: None
        """Called when an item has been queued, in the thread that receives."""
        self._items: deque[_Item] = deque(maxlen=KEPT if kept is None else kept)
        self._changed = threading.Condition()
        self._closed = False
        self._decode = decode
        try:
            self._subscriber = session.declare_subscriber(key_expr, self._receive)
        except zenoh.ZError as error:
            raise ClientError("unreachable", f"cannot subscribe to {key_expr}: {error}") from None
        self._thread: threading.Thread | None = None
        if callback is not None:
            self._thread = threading.Thread(
                target=self._call, args=(callback,), name=f"motord {key_expr}", daemon=True
            )
            self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the subscription; may be called twice, from any thread."""
        with self._changed:
            closed, self._closed = self._closed, True
            self._changed.notify_all()
        if not closed:
            with suppress(zenoh.ZError):  # its session is closed already
                self._subscriber.undeclare()  # type: ignore[no-untyped-call]
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(CLOSE_S)

    def get(self, timeout_s: float | None = None) -> _Item | None:
        """Return the next item, or None if none comes in time or the subscription is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._closed, timeout_s)
            if not self._items:
                return None
            item = self._items.popleft()
        self._passed_on(item)
        return item

    def __iter__(self) -> Iterator[_Item]:
        """Yield items until the subscription is closed."""
        while (item := self.get()) is not None:
            yield item

    def _passed_on(self, item: _Item) -> None:
        """Take note of an item on its way to the reader."""

    def _receive(self, sample: zenoh.Sample) -> None:
        try:
            item = self._decode(sample.payload.to_bytes())
        except ClientError as error:
            if not self.malformed:
                _log.warning("%s: %s", sample.key_expr, error)
            self.malformed += 1
            return
        self._queue(item)

    def _queue(self, item: _Item) -> None:
        with self._changed:
            if self._closed:
                return
            self.lost += len(self._items) == self._items.maxlen
            self._items.append(item)
            self._changed.notify()
        self.on_item()

    def _call(self, callback: Callable[[_Item], None]) -> None:
        for item in self:
            try:
                callback(item)
            except BaseException:  # a panic of a library in Rust, too: the next item may be well
                _log.exception("in a callback of a subscription")


class DocumentSubscription(Subscription[_Document]):
    """States, or progress of plans: none that is older than one before."""

    _newest_ns = 0
    _asked_ns = 0

    def add_latest(self, document: _Document) -> None:
        """Queue a document that was asked for, unless a newer one has come meanwhile."""
        with self._changed:
            if document.t_ns >= self._newest_ns:
                self._asked_ns = document.t_ns
                super()._queue(document)

    def _queue(self, item: _Document) -> None:
        with self._changed:
            if item.t_ns < self._asked_ns:
                return  # published before the one that was asked for
            self._asked_ns, self._newest_ns = 0, item.t_ns
            super()._queue(item)


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
