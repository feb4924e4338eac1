"""Subscriptions for asyncio: woken by the thread that receives, never polling."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from functools import partial
from typing import Generic, Self, TypeVar

import numpy as np

from motord.client.aio.threads import Threads
from motord.client.subscription import Subscription, TickLosses, TickSubscription

_Item = TypeVar("_Item")


class AsyncSubscription(Generic[_Item]):
    """Items of one key, by `async for` or `get`; begins with either, or with `async with`.

    They wait to be read, and are lost, as those of `motord.client.Subscription`. An `async for`
    that is left ends the subscription, unless that is inside its `async with`.
    """

    def __init__(self, threads: Threads, subscribe: Callable[[], Subscription[_Item]]) -> None:
        self._threads = threads
        self._subscribe = subscribe
        self._sync: Subscription[_Item] | None = None
        self._arrived = asyncio.Event()
        self._waking = self._closed = False

    @property
    def lost(self) -> int:
        """Items that were not read in time."""
        return self._sync.lost if self._sync is not None else 0

    @property
    def malformed(self) -> int:
        """Items that were not of their form."""
        return self._sync.malformed if self._sync is not None else 0

    async def __aenter__(self) -> Self:
        await self._opened()
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()

    async def close(self) -> None:
        """End the subscription."""
        self._closed = True
        self._arrived.set()
        if self._sync is not None:
            await self._threads.finish(self._sync.close)

    async def get(self, timeout_s: float | None = None) -> _Item | None:
        """Return the next item, or None if none comes in time or the subscription is closed."""
        sync = await self._opened()
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while True:
                    self._arrived.clear()
                    if (item := sync.get(0.0)) is not None or self._closed:
                        return item
                    await self._arrived.wait()
        return None

    async def __aiter__(self) -> AsyncIterator[_Item]:
        """Yield items until the subscription is closed."""
        is_entered = self._sync is not None
        try:
            while (item := await self.get()) is not None:
                yield item
        finally:
            if not is_entered:
                await self.close()

    async def _opened(self) -> Subscription[_Item]:
        if self._sync is None:
            loop = asyncio.get_running_loop()
            self._sync = await self._threads.enter(self._subscribe, Subscription.close)
            self._sync.on_item = partial(self._notify, loop)
        return self._sync

    def _notify(self, loop: asyncio.AbstractEventLoop) -> None:
        """Wake the event loop, from another thread; one call at a time waits for it."""
        if not self._waking:
            self._waking = True
            with suppress(RuntimeError):  # it has ended
                loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        self._waking = False
        self._arrived.set()


class AsyncTickSubscription(AsyncSubscription[np.ndarray]):
    """Blocks of ticks, and what is missing between them."""

    @property
    def losses(self) -> TickLosses:
        """What is missing up to the block read last."""
        return self._sync.losses if isinstance(self._sync, TickSubscription) else TickLosses()
