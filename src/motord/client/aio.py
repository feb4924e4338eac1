"""The client for asyncio: what `motord.client` does, awaited.

>>> import asyncio
>>> from motord.client import aio
>>> async def main():
...     async with aio.connect() as client, client.lease() as lease:
...         await lease.set(enable=True, torque_Nm=0.5, speed_Hz=0.5)
...         async for block in client.subscribe_ticks():
...             if block["torque_set_Nm"][-1] == 0.5:
...                 return "reached"
>>> asyncio.run(main())
'reached'

Threads of the client wait for replies, the event loop does not. A cancelled task gives its lease
back and ends its subscriptions before it ends; a request that is under way is carried out.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

import numpy as np

from motord.api.messages import BenchState, Event, PlanView
from motord.client import discovery
from motord.client.client import KEPT_BLOCKS, Client
from motord.client.commander import Commander
from motord.client.in_threads import Threads, awaited
from motord.client.lease import Lease
from motord.client.plan_run import PlanRun
from motord.client.subscription import Subscription
from motord.client.tick_subscription import TickLosses, TickSubscription
from motord.security.identity import Identity

_Item = TypeVar("_Item")


def connect(
    bench: str | None = None,
    endpoint: str | None = None,
    identity: Identity | Path | str | None = None,
) -> "AsyncClient":
    """Return a client that connects as `motord.client.connect` does when its block is entered."""
    return AsyncClient(partial(discovery.connect, bench, endpoint, identity))


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


class AsyncPlanRun:
    """One run of a plan, as `motord.client.PlanRun`, which begins when it is iterated or awaited.

    Iterating yields its progress until it is over; to stop iterating does not stop the plan.
    """

    def __init__(self, threads: Threads, begin: Callable[[], PlanRun]) -> None:
        self._threads = threads
        self._begin = begin
        self._sync: PlanRun | None = None

    async def __aiter__(self) -> AsyncIterator[PlanView]:
        """Yield progress ten times a second, and at last that of the end."""
        if self._sync is None:
            self._sync = await self._threads.finish(self._begin)
        progress = iter(self._sync)
        try:
            while (each := await self._threads.finish(next, progress, None)) is not None:
                yield each
        finally:
            await self._threads.finish(progress.close)

    async def wait(self) -> PlanView:
        """Wait until the plan is done; return its last progress. Raises as iterating does."""
        async for progress in self:
            last = progress
        return last


class AsyncLease:
    """The lease while an `async with` block runs, as `motord.client.Lease`.

    It is renewed by a thread. `lost` is set when it is lost, with the reason in `why`.
    """

    enable = awaited(Commander.enable)
    disable = awaited(Commander.disable)
    reset = awaited(Commander.reset)
    set = awaited(Commander.set)
    start_plan = awaited(Commander.start_plan)
    pause_plan = awaited(Commander.pause_plan)
    resume_plan = awaited(Commander.resume_plan)
    abort_plan = awaited(Commander.abort_plan)
    discard_plan = awaited(Commander.discard_plan)
    install_calibration = awaited(Commander.install_calibration)

    def __init__(self, threads: Threads, lease: Lease) -> None:
        self.threads, self.sync = threads, lease
        self.lost = asyncio.Event()

    @property
    def token(self) -> str:
        """What requests that need the lease are made with."""
        return self.sync.token

    @property
    def why(self) -> str:
        """Why the lease was lost, "" if it was not."""
        return self.sync.why

    async def __aenter__(self) -> Self:
        loop = asyncio.get_running_loop()

        def on_lost() -> None:
            with suppress(RuntimeError):  # the event loop has ended
                loop.call_soon_threadsafe(self.lost.set)

        self.sync.on_lost = on_lost
        await self.threads.enter(self.sync.__enter__, Lease.release)
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.threads.finish(self.sync.release)

    def run_plan(
        self,
        name: str,
        settings: Mapping[str, Any] | None = None,
        *,
        detach: bool = False,
        notes: str = "",
    ) -> AsyncPlanRun:
        """Return a plan that starts when it is iterated or awaited; as of `Commander.run_plan`."""
        begin = partial(self.sync.run_plan, name, settings, detach=detach, notes=notes)
        return AsyncPlanRun(self.threads, begin)


class AsyncClient:
    """A connection to one daemon while an `async with` block runs, as `motord.client.Client`."""

    rpc = awaited(Client.rpc)
    state = awaited(Client.state)
    events = awaited(Client.events)
    plan = awaited(Client.plan)
    plans = awaited(Client.plans)
    dry_run = awaited(Client.dry_run)
    config = awaited(Client.config)
    stop = awaited(Client.stop)

    def __init__(self, opening: Callable[[], Client]) -> None:
        self.threads = Threads()
        self._opening = opening
        self._sync: Client | None = None

    @property
    def sync(self) -> Client:
        """The client for threads. Raises RuntimeError outside of the block."""
        if self._sync is None:
            raise RuntimeError("not connected: use the client within `async with`")
        return self._sync

    @property
    def bench(self) -> str:
        """Name of the bench."""
        return self.sync.bench

    async def __aenter__(self) -> Self:
        self._sync = await self.threads.enter(self._opening, Client.close)
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.threads.finish(self.sync.close)
        self.threads.end()

    def follow_plan(self) -> AsyncPlanRun:
        """Return the plan under way or the last one, to iterate over its progress."""
        return AsyncPlanRun(self.threads, self.sync.follow_plan)

    def lease(self, holder: str | None = None, *, force: bool = False) -> AsyncLease:
        """Return a lease, acquired, renewed and given back by `async with`."""
        return AsyncLease(self.threads, self.sync.lease(holder, force=force))

    def subscribe_state(self, *, latest: bool = True) -> AsyncSubscription[BenchState]:
        """Receive the state now, then ten times a second and when it changes."""
        return AsyncSubscription(self.threads, partial(self.sync.subscribe_state, latest=latest))

    def subscribe_plan(self, *, latest: bool = True) -> AsyncSubscription[PlanView]:
        """Receive the progress of plans, the present one first."""
        return AsyncSubscription(self.threads, partial(self.sync.subscribe_plan, latest=latest))

    def subscribe_events(self) -> AsyncSubscription[Event]:
        """Receive events as they happen."""
        return AsyncSubscription(self.threads, self.sync.subscribe_events)

    def subscribe_ticks(self, *, kept: int = KEPT_BLOCKS) -> AsyncTickSubscription:
        """Receive every tick, in blocks: structured arrays of shape (n,), `schema.TICK_DTYPE`."""
        return AsyncTickSubscription(self.threads, partial(self.sync.subscribe_ticks, kept=kept))
