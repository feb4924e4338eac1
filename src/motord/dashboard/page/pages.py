"""The pages that are open, and what comes from the daemon to all of them."""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any

from pydantic_core import to_json

from motord.api.messages import BenchState, Event
from motord.api.queue_messages import QueueView
from motord.api.queue_requests import QUEUE_LIST
from motord.api.requests import CALIBRATION_SHOW
from motord.client import ClientError
from motord.client.holder import LENGTH_MAX
from motord.dashboard.bench_link import BenchLink, Item
from motord.dashboard.live_bench import LiveBench
from motord.dashboard.page.live_page import LivePage
from motord.security.roles import Role

AGAIN_S = 1.0
"""Until a daemon that did not say is asked again."""

PAGES_MAX = 16
SIGNIFICANT = 2.0
"""Standard errors that an order of the cogging torque must exceed to be marked."""

LOOK_UP_S = 1.0
RESTARTED = "the daemon was started again: whoever was in command no longer is"


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


class Pages:
    """Open pages of one bench. `who` names the user and the machine in the holders of leases."""

    def __init__(self, bench: LiveBench, link: BenchLink, who: str) -> None:
        self.bench = bench
        self._link = link
        self._who = who
        self._open: set[LivePage] = set()
        self._number = 0
        self._uptime_s = 0.0
        self._calibration = ""
        self._lookup: asyncio.Task[None] | None = None
        self._queue = QueueLookup(link, partial(bench.set_document, "queue"))

    @property
    def bench_name(self) -> str:
        """Name of the bench."""
        return self.bench.bench

    @property
    def full(self) -> bool:
        """True if no more pages may be opened."""
        return len(self._open) >= PAGES_MAX

    def open(self, role: Role) -> LivePage:
        """Return a new page."""
        self._number += 1
        number = f" page {self._number}"
        holder = self._who[: LENGTH_MAX - len(number)] + number
        page = LivePage(holder, role, self.bench, self._link)
        self._open.add(page)
        return page

    async def close(self, page: LivePage) -> None:
        """Forget a page; its lease is given back."""
        self._open.discard(page)
        await page.close()

    def publish(self, kind: str, message: bytes) -> None:
        """Send a message to every page."""
        for page in self._open:
            page.publish(kind, message)

    def take(self, items: list[Item]) -> None:
        """Take in what came from the daemon."""
        self.bench.take(items)
        self._queue.take(items)
        for _, item in items:
            if isinstance(item, BenchState):
                self._follow(item)
        for page in self._open:
            page.wake()

    async def connected(self) -> None:
        """Take in what a daemon remembers, after connecting to it. Raises ClientError."""
        config = (await self._link.call("config"))["config"]
        events = await self._link.look("events")
        documents = {kind: await self._link.look(kind) for kind in ("plan", "mesh")}
        if config != self.bench.config:
            self.bench.set_config(config)
        self.bench.set_events(events)
        for kind, document in documents.items():
            self.bench.set_document(kind, document.to_json() if document else b"null")
        self._queue.forget()
        for page in self._open:
            page.begin()

    def _follow(self, state: BenchState) -> None:
        """Notice another start of the daemon, and another calibration."""
        if state.uptime_s < self._uptime_s:
            for page in self._open:
                page.lease.lose(RESTARTED)
        self._uptime_s = state.uptime_s
        calibration = state.calibration.id if state.calibration is not None else ""
        looking = self._lookup is not None and not self._lookup.done()
        if calibration != self._calibration and not looking:
            self._lookup = asyncio.create_task(self._look_up_orders(calibration))

    async def _look_up_orders(self, calibration: str) -> None:
        """Find out which orders of the turn the calibration in force makes up for.

        Where the daemon does not say, it is asked again after `LOOK_UP_S`.
        """
        harmonics: list[dict[str, Any]] = []
        if calibration:
            try:
                shown = await self._link.call(CALIBRATION_SHOW.name, id=calibration)
            except ClientError:
                await asyncio.sleep(LOOK_UP_S)
                return
            harmonics = shown["tau_cog_harmonics"]
        self._calibration = calibration
        self.bench.calibrated = [
            h["order"]
            for h in harmonics
            if abs(h["amplitude_Nm"]) > SIGNIFICANT * (h["stderr_Nm"] or 0)
        ]
