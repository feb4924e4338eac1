"""The connection to the daemon: what it publishes comes to the event loop, requests go out.

Zenoh calls back in threads of its own; what comes is gathered and taken to the event loop in one
step. A connection on which nothing comes any more is made anew, for as long as it takes.
"""

import asyncio
import logging
import threading
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from motord.api.messages import BenchState
from motord.client import Client, ClientError, Subscription
from motord.process.ending_threads import started_pool

SILENT_S = 0.4
"""States come ten times a second: after so long without one the daemon is not there."""
RECONNECT_S = 2.0
"""After so long the connection is made anew; a new one is given as long."""
LOOK_S = 0.5
WAITING_MAX = 200
"""Blocks of ticks that wait for the event loop; older ones are dropped, and count as lost."""
REQUEST_THREADS, URGENT_THREADS = 12, 4

Item = tuple[str, Any]
"""What came: the name of its key, and the message or block of ticks."""


class _Inbox:
    """What Zenoh's threads have brought, on its way to the event loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop, take: Callable[[list[Item]], None]) -> None:
        self._loop = loop
        self._take = take
        self._lock = threading.Lock()
        self._items: list[Item] = []

    def put(self, name: str, item: Any) -> None:
        """Add an item, from any thread."""
        with self._lock:
            first = not self._items
            self._items.append((name, item))
            if len(self._items) > WAITING_MAX:
                self._items = _without_oldest_ticks(self._items)
        if first:
            with suppress(RuntimeError):  # the event loop is over
                self._loop.call_soon_threadsafe(self._deliver)

    def _deliver(self) -> None:
        with self._lock:
            items, self._items = self._items, []
        self._take(items)


def _close(subscriptions: Sequence[Subscription[Any]], client: Client) -> None:
    """End a connection with the threads of its subscriptions."""
    for subscription in subscriptions:
        subscription.close()
    client.close()


def _without_oldest_ticks(items: list[Item]) -> list[Item]:
    oldest = next((at for at, (name, _) in enumerate(items) if name == "ticks"), 0)
    return items[:oldest] + items[oldest + 1 :]


@dataclass(frozen=True)
class Connectivity:
    """Whether the daemon publishes; `age_s` of its newest state."""

    alive: bool
    age_s: float
    message: str


class BenchLink:
    """A client of a daemon, for an event loop. `connect` makes the connection anew."""

    def __init__(self, client: Client, connect: Callable[[], Client]) -> None:
        self.client = client
        self._connect = connect
        self._inbox: _Inbox | None = None
        self._subscriptions: list[Subscription[Any]] = []
        self._received_s = self._connected_s = time.monotonic()
        self._why = ""
        self._requests = started_pool(REQUEST_THREADS, "motord-rpc")
        self._urgent = started_pool(URGENT_THREADS, "motord-urgent")

    def start(self, take: Callable[[list[Item]], None]) -> None:
        """Subscribe, in the running event loop. `take` gets what comes, in the order of coming."""

        def received(items: list[Item]) -> None:
            if any(isinstance(item, BenchState) for _, item in items):
                self._received_s = time.monotonic()
            take(items)

        self._inbox = _Inbox(asyncio.get_running_loop(), received)
        self._subscribe()

    async def call(self, name: str, /, *, urgent: bool = False, **arguments: Any) -> dict[str, Any]:
        """Call an RPC. Those that are `urgent` never wait for others. Raises ClientError."""
        pool = self._urgent if urgent else self._requests
        client = self.client
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(pool, lambda: client.rpc(name, **arguments))

    async def look(self, method: str) -> Any:
        """Call a method of the client that asks for the newest document. Raises ClientError."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._requests, getattr(self.client, method))

    def connectivity(self) -> Connectivity:
        """Return whether the daemon is there."""
        age_s = time.monotonic() - self._received_s
        alive = age_s < SILENT_S
        where = f"the daemon of bench '{self.client.bench}' at {self.client.endpoint}"
        message = "" if alive else f"{where} publishes nothing; {self._why or 'waiting for it'}"
        return Connectivity(alive, round(age_s, 3), message)

    async def keep(self, connected: Callable[[], Awaitable[None]]) -> None:
        """Look after the connection; never returns.

        `connected` is called at first, and when the daemon is there again, this one or another one:
        what it published meanwhile was missed. It is called again if it raises ClientError, as it
        does while Zenoh does not know yet who answers there.
        """
        missed = True
        while True:
            age_s = time.monotonic() - self._received_s
            missed = missed or age_s >= SILENT_S
            try:
                if missed and age_s < SILENT_S:
                    await connected()
                    missed, self._why = False, ""
                elif min(age_s, time.monotonic() - self._connected_s) > RECONNECT_S:
                    await self._reconnect()
            except ClientError as error:
                self._why = str(error)
            except Exception as error:  # it has to go on: nobody else connects again
                self._why = f"{type(error).__name__}: {error}"
                logging.getLogger("motord").exception("connecting to the daemon")
            await asyncio.sleep(LOOK_S)

    async def _reconnect(self) -> None:
        """Zenoh connects again by itself; where it does not, a new connection does."""
        client = await asyncio.to_thread(self._connect)
        before, self.client = self.client, client
        subscriptions, self._subscriptions = self._subscriptions, []
        try:
            await asyncio.to_thread(self._subscribe)
            self._connected_s = time.monotonic()
        finally:
            await asyncio.to_thread(_close, subscriptions, before)

    def close(self) -> None:
        """End the connection."""
        self._requests.shutdown(wait=False, cancel_futures=True)
        self._urgent.shutdown(wait=False)
        self.client.close()

    def _subscribe(self) -> None:
        client = self.client

        def put(name: str, item: Any) -> None:
            if client is self.client and self._inbox is not None:  # not one that is being closed
                self._inbox.put(name, item)

        for subscribe, name in (
            (client.subscribe_state, "state"),
            (client.subscribe_events, "event"),
            (client.subscribe_plan, "plan"),
            (client.subscribe_mesh, "mesh"),
            (client.subscribe_ticks, "ticks"),
        ):
            self._subscriptions.append(subscribe(partial(put, name)))
