"""Subscriptions to the keys of a daemon."""

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Generic, Self, TypeVar

import zenoh

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
