"""Subscription to one key of a daemon."""

import logging
import queue
from collections.abc import Callable, Iterator
from typing import Generic, Self, TypeVar

import zenoh

from motord.client.error import ClientError

KEPT = 1000
WAIT_S = 1.0

_Item = TypeVar("_Item")


class Subscription(Generic[_Item]):
    """Items of one key: passed to a callback, or queued for `get` and iteration.

    At most `KEPT` items are queued; older ones are dropped and counted in `lost`. Malformed items
    are dropped and counted in `malformed`; the first is logged. The callback runs in a thread of
    its own.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key_expr: str,
        decode: Callable[[bytes], _Item],
        callback: Callable[[_Item], None] | None,
    ) -> None:
        self.lost = self.malformed = 0
        self._items: queue.Queue[_Item] = queue.Queue(KEPT)
        self._decode = decode
        self._callback = callback
        self._subscriber = session.declare_subscriber(key_expr, self._receive)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the subscription."""
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]

    def get(self, timeout_s: float) -> _Item | None:
        """Return the next item, or None if none comes in time."""
        try:
            return self._items.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def __iter__(self) -> Iterator[_Item]:
        """Yield items without end."""
        while True:
            item = self.get(WAIT_S)
            if item is not None:
                yield item

    def _receive(self, sample: zenoh.Sample) -> None:
        try:
            item = self._decode(sample.payload.to_bytes())
        except ClientError as error:
            if not self.malformed:
                logging.getLogger("motord").warning("%s: %s", sample.key_expr, error)
            self.malformed += 1
            return
        if self._callback is not None:
            self._callback(item)
            return
        while True:
            try:
                self._items.put_nowait(item)
                return
            except queue.Full:
                self._drop_oldest()

    def _drop_oldest(self) -> None:
        try:
            self._items.get_nowait()
            self.lost += 1
        except queue.Empty:
            return
