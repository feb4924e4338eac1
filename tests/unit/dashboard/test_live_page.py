"""A page that takes nothing any more: it costs a socket for a while, and nobody else anything."""

import asyncio

import pytest

from motord import config
from motord.api.requests import LeaseAcquire
from motord.dashboard import app
from motord.dashboard.frames import decode
from motord.dashboard.live_bench import LiveBench
from motord.dashboard.page import sending
from motord.dashboard.page.live_page import CALLS_MAX, LivePage
from motord.dashboard.page.messages import RpcCall
from motord.dashboard.page.pages import Pages
from motord.dashboard.page.sending import PageGone
from motord.security.roles import Role
from tests.support.patience import PATIENCE_S
from tests.unit.dashboard.fake_link import FakeLink
from tests.unit.dashboard.ticks import block


async def never(_):
    await asyncio.Event().wait()


def test_a_page_that_takes_nothing_is_gone(monkeypatch):
    monkeypatch.setattr(sending, "GONE_S", 0.01)

    async def main():
        bench = LiveBench("sim", config.load().model_dump(mode="json"))
        page = LivePage("anna@bench page 1", Role.OPERATOR, bench, FakeLink())
        async with asyncio.timeout(PATIENCE_S):
            await page.send_all(never)

    with pytest.raises(PageGone):
        asyncio.run(main())


def test_closing_it_does_not_wait_for_it(monkeypatch):
    monkeypatch.setattr(app, "CLOSE_S", 0.01)

    class Socket:
        send_bytes = staticmethod(never)

    async def main():
        async with asyncio.timeout(PATIENCE_S):
            await app._close(Socket(), app.NO_ANSWER, "it has not answered")

    asyncio.run(main())


def test_a_page_receives_the_age_of_the_newest_ticks():
    async def age_s(items):
        bench = LiveBench("sim", config.load().model_dump(mode="json"))
        page = LivePage("anna@bench page 1", Role.OPERATOR, bench, FakeLink())
        said = []

        async def keep(message):
            said.append(decode(message)[0])
            if said[-1]["kind"] == "connection":
                raise PageGone

        bench.ticks_s -= PATIENCE_S
        bench.take(items)
        async with asyncio.timeout(PATIENCE_S):
            with pytest.raises(PageGone):
                await page.send_all(keep)
        return said[-1]["tick_age_s"]

    assert asyncio.run(age_s([])) >= PATIENCE_S
    assert asyncio.run(age_s([("ticks", block(3))])) < PATIENCE_S


def test_stops_without_end_are_not_all_kept():
    class Silent(FakeLink):
        async def call(self, name, /, *, urgent=False, **arguments):
            self.calls.append((name, arguments))
            await never(name)

    async def main():
        bench = LiveBench("sim", config.load().model_dump(mode="json"))
        link = Silent()
        page = LivePage("anna@bench page 1", Role.OPERATOR, bench, link)
        for n in range(100):
            page.received(RpcCall(kind="rpc", id=n, name="note" if n < 50 else "stop"))
        await asyncio.sleep(0)
        return [name for name, _ in link.calls]

    called = asyncio.run(main())
    assert (called.count("note"), called.count("stop")) == (CALLS_MAX, CALLS_MAX)


def test_a_long_name_of_user_and_host_leaves_room_for_the_number_of_the_page():
    bench = LiveBench("sim", config.load().model_dump(mode="json"))
    page = Pages(bench, FakeLink(), "a" * 40 + "@" + "b" * 40).open(Role.OPERATOR)
    asked = LeaseAcquire(holder=page.lease.holder)
    assert asked.holder.endswith("b page 1")
