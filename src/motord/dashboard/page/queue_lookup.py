"""All of the queue of plans, asked for whenever the daemon reports that something in it changed."""

import asyncio
from collections.abc import Callable

from pydantic_core import to_json

from motord.api.messages import BenchState, Event
from motord.api.queue_messages import QueueView
from motord.api.queue_requests import QUEUE_LIST
from motord.client import ClientError
from motord.dashboard.bench_link import BenchLink, Item

AGAIN_S = 1.0
"""Until a daemon that did not say is asked again."""


class QueueLookup:
    """Asks for the queue, one request at a time; `show` gets the answer as JSON."""

    def __init__(self, link: BenchLink, show: Callable[[bytes], None]) -> None:
        self._link = link
        self._show = show
        self._seen: QueueView | None = None
        self._due = False
        self._request: asyncio.Task[None] | None = None

    def forget(self) -> None:
        """Ask again with the next state, whatever that says: what came meanwhile was missed."""
        self._seen = None

    def take(self, items: list[Item]) -> None:
        """Look at what came from the daemon; a daemon without a queue is asked nothing."""
        for _, item in items:
            if isinstance(item, BenchState) and item.queue is not None:
                # time left and message are in each state, and change all the time
                now = item.queue.model_copy(update={"eta_s": 0.0, "message": ""})
                self._due = self._due or now != self._seen
                self._seen = now
            elif isinstance(item, Event) and item.kind == "queue":
                self._due = True
        if self._due and (self._request is None or self._request.done()):
            self._request = asyncio.create_task(self._ask())

    async def _ask(self) -> None:
        while self._due:
            self._due = False
            try:
                content = await self._link.call(QUEUE_LIST.name)
            except ClientError:
                self._due = True
                await asyncio.sleep(AGAIN_S)
                return
            self._show(to_json(content, inf_nan_mode="null"))
