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
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from functools import partial, wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, Self

from motord.api.messages import BenchState, Event
from motord.api.plan_messages import MeshView, PlanView
from motord.client import discovery
from motord.client.aio.subscription import AsyncSubscription, AsyncTickSubscription
from motord.client.aio.threads import HasSync, Threads, awaited
from motord.client.client import KEPT_BLOCKS, Client
from motord.client.commander import Commander
from motord.client.lease import Lease
from motord.client.plan_run import PlanRun
from motord.security.identity import Identity

_P = ParamSpec("_P")


def connect(
    bench: str | None = None,
    endpoint: str | None = None,
    identity: Identity | Path | str | None = None,
) -> "AsyncClient":
    """Return a client that connects as `motord.client.connect` does when its block is entered."""
    return AsyncClient(partial(discovery.connect, bench, endpoint, identity))


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


def followed(
    begin: Callable[Concatenate[Any, _P], PlanRun],
) -> Callable[Concatenate[Any, _P], AsyncPlanRun]:
    """Return a method that returns the plan which `begin` of the object that waits begins."""

    @wraps(begin)
    def later(self: HasSync, /, *args: _P.args, **named: _P.kwargs) -> AsyncPlanRun:
        return AsyncPlanRun(self.threads, partial(begin, self.sync, *args, **named))

    return later


class AsyncLease:
    """The lease while an `async with` block runs, as `motord.client.Lease`.

    It is renewed by a thread. `lost` is set when it is lost, with the reason in `why`.
    """

    enable = awaited(Commander.enable)
    disable = awaited(Commander.disable)
    reset = awaited(Commander.reset)
    set = awaited(Commander.set)
    start_plan = awaited(Commander.start_plan)
    run_plan = followed(Commander.run_plan)
    pause_plan = awaited(Commander.pause_plan)
    resume_plan = awaited(Commander.resume_plan)
    abort_plan = awaited(Commander.abort_plan)
    discard_plan = awaited(Commander.discard_plan)
    add_to_queue = awaited(Commander.add_to_queue)
    move_in_queue = awaited(Commander.move_in_queue)
    remove_from_queue = awaited(Commander.remove_from_queue)
    start_queue = awaited(Commander.start_queue)
    pause_queue = awaited(Commander.pause_queue)
    install_calibration = awaited(Commander.install_calibration)
    adopt_calibration = awaited(Commander.adopt_calibration)

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


class AsyncClient:
    """A connection to one daemon while an `async with` block runs, as `motord.client.Client`."""

    rpc = awaited(Client.rpc)
    state = awaited(Client.state)
    events = awaited(Client.events)
    plan = awaited(Client.plan)
    mesh = awaited(Client.mesh)
    plans = awaited(Client.plans)
    dry_run = awaited(Client.dry_run)
    queue = awaited(Client.queue)
    config = awaited(Client.config)
    stop = awaited(Client.stop)
    note = awaited(Client.note)
    follow_plan = followed(Client.follow_plan)

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

    def lease(self, holder: str | None = None, *, force: bool = False) -> AsyncLease:
        """Return a lease, acquired, renewed and given back by `async with`."""
        return AsyncLease(self.threads, self.sync.lease(holder, force=force))

    def subscribe_state(self, *, latest: bool = True) -> AsyncSubscription[BenchState]:
        """Receive the state now, then ten times a second and when it changes."""
        return AsyncSubscription(self.threads, partial(self.sync.subscribe_state, latest=latest))

    def subscribe_plan(self, *, latest: bool = True) -> AsyncSubscription[PlanView]:
        """Receive the progress of plans, the present one first."""
        return AsyncSubscription(self.threads, partial(self.sync.subscribe_plan, latest=latest))

    def subscribe_mesh(self) -> AsyncSubscription[MeshView]:
        """Receive the operating points of a plan whenever something becomes of one."""
        return AsyncSubscription(self.threads, self.sync.subscribe_mesh)

    def subscribe_events(self) -> AsyncSubscription[Event]:
        """Receive events as they happen."""
        return AsyncSubscription(self.threads, self.sync.subscribe_events)

    def subscribe_ticks(self, *, kept: int = KEPT_BLOCKS) -> AsyncTickSubscription:
        """Receive every tick, in blocks: structured arrays of shape (n,), `schema.TICK_DTYPE`."""
        return AsyncTickSubscription(self.threads, partial(self.sync.subscribe_ticks, kept=kept))
