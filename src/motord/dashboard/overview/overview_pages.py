"""The open pages of the overview: each gets all benches, again and again; none may command."""

import asyncio
import shlex
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from pydantic_core import to_json

from motord.client.benches import Benches
from motord.client.roster import BenchEntry
from motord.dashboard.frames import encode_document
from motord.dashboard.overview.bench_list import BenchList
from motord.dashboard.page.messages import PageMessage
from motord.dashboard.page.pages import PAGES_MAX
from motord.dashboard.page.sending import Sender, in_time
from motord.security.roles import Role

LOOK_S = 0.4
"""Longest time between two looks at the benches, which wake the server when something comes."""
PAUSE_S = 0.2
"""Least time between two looks, however many benches publish."""


def command_for(identity: Path | None) -> Callable[[BenchEntry], str]:
    """Return what gives the command that opens the own page of a bench."""

    def command(entry: BenchEntry) -> str:
        command = ["motord", "dashboard", "--port", "0", "--bench", entry.bench]
        command += ["--connect", entry.endpoint] if entry.endpoint else []
        return shlex.join(command + (["--identity", str(identity)] if identity else []))

    return command


class BenchesLink:
    """All benches, for an event loop: what is known of them as soon as something comes."""

    def __init__(self, benches: Benches) -> None:
        self._benches = benches
        self._take: Callable[[list[Any]], None] = lambda entries: None

    def start(self, take: Callable[[list[Any]], None]) -> None:
        """Give each new list of entries to `take`."""
        self._take = take

    async def keep(self, connected: Callable[[], Awaitable[None]]) -> None:
        """Look at the benches; never returns."""
        while True:
            self._take(self._benches.entries())
            await asyncio.sleep(PAUSE_S)
            await asyncio.to_thread(self._benches.wait, LOOK_S)


class OverviewPage:
    """A page of the overview, which gets the newest message as fast as it takes them."""

    def __init__(self, message: bytes) -> None:
        self._message = message
        self._news = asyncio.Event()
        self._news.set()

    def publish(self, message: bytes) -> None:
        """Have a message sent; the newest only."""
        self._message = message
        self._news.set()

    async def send_all(self, send: Sender) -> None:
        """Send what there is to send; never returns. Raises PageGone."""
        send = in_time(send)
        while True:
            await self._news.wait()
            self._news.clear()
            await send(self._message)

    def received(self, message: PageMessage) -> None:
        """Do nothing: there is nothing that this page may ask for."""


class OverviewPages:
    """Open pages of all benches. `unreachable` says why an endpoint cannot be reached."""

    bench_name = ""

    def __init__(self, benches: BenchList, unreachable: Callable[[], list[str]]) -> None:
        self._benches = benches
        self._unreachable = unreachable
        self._open: set[OverviewPage] = set()
        self._message = encode_document("benches", b'{"benches":[],"unreachable":[]}')

    @property
    def full(self) -> bool:
        """True if no more pages may be opened."""
        return len(self._open) >= PAGES_MAX

    def open(self, role: Role) -> OverviewPage:
        """Return a new page, a viewer's whoever opens it."""
        page = OverviewPage(self._message)
        self._open.add(page)
        return page

    async def close(self, page: OverviewPage) -> None:
        """Forget a page."""
        self._open.discard(page)

    def take(self, entries: list[BenchEntry]) -> None:
        """Show the benches as they are now."""
        shown = self._benches.update(entries, time.time_ns())
        document = {"benches": shown, "unreachable": self._unreachable()}
        self._message = encode_document("benches", to_json(document, inf_nan_mode="null"))
        for page in self._open:
            page.publish(self._message)

    async def connected(self) -> None:
        """Do nothing: `Benches` connects by itself."""
