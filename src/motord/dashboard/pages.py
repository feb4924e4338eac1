"""The pages that are open, and what comes from the daemon to all of them."""

from contextlib import suppress

from motord.api.messages import BenchState
from motord.client import ClientError
from motord.dashboard.bench_link import BenchLink, Item
from motord.dashboard.live_bench import LiveBench
from motord.dashboard.live_page import LivePage
from motord.security.roles import Role

PAGES_MAX = 16
RESTARTED = "the daemon was started again: whoever was in command no longer is"


class Pages:
    """Open pages of one bench.

    `who` names the user and the machine in the holders of leases.
    """

    def __init__(self, bench: LiveBench, link: BenchLink, who: str) -> None:
        self.bench = bench
        self._link = link
        self._who = who
        self._open: set[LivePage] = set()
        self._number = 0
        self._uptime_s = 0.0

    @property
    def full(self) -> bool:
        """True if no more pages may be opened."""
        return len(self._open) >= PAGES_MAX

    def open(self, role: Role) -> LivePage:
        """Return a new page."""
        self._number += 1
        page = LivePage(f"{self._who} page {self._number}", role, self.bench, self._link)
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
        for _, item in items:
            if isinstance(item, BenchState):
                self._follow(item)
        for page in self._open:
            page.wake()

    async def connected(self) -> None:
        """Take in what a daemon remembers, after connecting to it."""
        with suppress(ClientError):  # gone again meanwhile
            config = (await self._link.call("config"))["config"]
            if config != self.bench.config:
                self.bench.set_config(config)
            self.bench.set_events(await self._link.look("events"))
            plan = await self._link.look("plan")
            if plan is not None:
                self.bench.set_document("plan", plan.to_json())
            for page in self._open:
                page.begin()

    def _follow(self, state: BenchState) -> None:
        """Notice another start of the daemon."""
        if state.uptime_s < self._uptime_s:
            for page in self._open:
                page.lease.lose(RESTARTED)
        self._uptime_s = state.uptime_s
