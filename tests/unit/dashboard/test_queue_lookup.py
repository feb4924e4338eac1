"""When the server of the page asks the daemon for the queue, and what pages get of it."""

import asyncio
import json

import pytest

from motord.api.messages import BenchState, Event
from motord.api.queue_messages import QueueView
from motord.client import ClientError
from motord.dashboard.page import pages
from motord.dashboard.page.pages import QueueLookup
from tests.unit.dashboard.fake_link import FakeLink


class Lookup:
    """A lookup, what it asked and what it showed."""

    def __init__(self):
        self.link, self.shown = FakeLink(), []
        self.lookup = QueueLookup(self.link, lambda content: self.shown.append(json.loads(content)))

    async def come(self, *items):
        self.lookup.take([("item", item) for item in items])
        for _ in range(5):
            await asyncio.sleep(0)
        return len(self.link.named("queue/list"))


def state(**queue):
    return BenchState.model_construct(queue=QueueView(**queue))


def event(kind):
    return Event(t_ns=1, kind=kind, message="3 moved to place 1 by anna", data={})


def test_the_queue_is_asked_for_when_it_is_another_one_and_not_with_every_state():
    async def run():
        seen = Lookup()
        assert await seen.come(BenchState.model_construct(queue=None), event("plan")) == 0
        assert await seen.come(state(length=2, eta_s=9.0)) == 1
        assert await seen.come(state(length=2, eta_s=8.0, message="waits until 06:00")) == 1
        assert await seen.come(state(length=2, state="running", running=1)) == 2
        assert await seen.come(event("queue")) == 3  # of a move the state says nothing
        seen.lookup.forget()
        assert await seen.come(state(length=2, state="running", running=1)) == 4
        assert seen.shown == [{"state": "READY"}] * 4

    asyncio.run(run())


def test_a_change_while_the_answer_is_on_its_way_is_asked_for_again():
    async def run():
        seen, gate = Lookup(), asyncio.Event()
        at_once = seen.link.call

        async def call(name):
            content = await at_once(name)
            await gate.wait()
            return content

        seen.link.call = call
        assert await seen.come(state(length=1)) == 1
        assert await seen.come(event("queue"), event("queue")) == 1
        gate.set()
        assert await seen.come() == 2

    asyncio.run(run())


@pytest.mark.parametrize("items", [[state(length=1)], []])
def test_a_daemon_that_did_not_say_is_asked_again(items, monkeypatch):
    monkeypatch.setattr(pages, "AGAIN_S", 0.0)

    async def run():
        seen = Lookup()
        seen.link.errors["queue/list"] = ClientError("busy", "later")
        assert await seen.come(state(length=1)) == 1
        assert seen.shown == []
        seen.link.errors.clear()
        assert await seen.come(*items) == 2
        assert seen.shown == [{"state": "READY"}]

    asyncio.run(run())
