"""The connection to the daemon: whatever goes wrong, it goes on and leaves nothing behind."""

import asyncio
import threading
from types import SimpleNamespace

import pytest

from motord.client import ClientError
from motord.dashboard import bench_link
from motord.dashboard.bench_link import BenchLink
from motord.process.ending_threads import NoThreadError
from tests.support.patience import PATIENCE_S


class FakeSubscription:
    closed = False

    def __init__(self, callback):
        self.callback = callback

    def close(self):
        self.closed = True


class FakeClient:
    """Notes who subscribes; `publish` lets an item come."""

    bench, endpoint = "sim", "tcp/127.0.0.1:1"

    def __init__(self):
        self.subscriptions, self.closed = {}, False

    def __getattr__(self, name):
        if not name.startswith("subscribe_"):
            raise AttributeError(name)

        def subscribe(callback):
            self.subscriptions[name] = FakeSubscription(callback)
            return self.subscriptions[name]

        return subscribe

    def publish(self, item):
        self.subscriptions["subscribe_mesh"].callback(item)

    def close(self):
        self.closed = True


@pytest.fixture(autouse=True)
def hurried(monkeypatch):
    monkeypatch.setattr(bench_link, "LOOK_S", 0.001)


async def until(condition):
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            await asyncio.sleep(0.001)


async def kept(link, connected, condition):
    """Keep the connection until `condition()`."""
    keeping = asyncio.create_task(link.keep(connected))
    await until(lambda: condition() or keeping.done())
    assert not keeping.done(), keeping.exception()
    keeping.cancel()


def refuse(_thread):
    raise RuntimeError("can't start new thread")


def test_a_stop_needs_no_further_thread(monkeypatch):
    client = FakeClient()
    client.rpc = lambda name: {"carried out": name}
    link = BenchLink(client, FakeClient)
    monkeypatch.setattr(threading.Thread, "start", refuse)
    assert asyncio.run(link.call("stop", urgent=True)) == {"carried out": "stop"}
    link.close()


def test_a_page_for_which_there_are_no_threads_says_what_to_do(monkeypatch):
    monkeypatch.setattr(threading.Thread, "start", refuse)
    with pytest.raises(NoThreadError, match="ulimit -u"):
        BenchLink(FakeClient(), FakeClient)


@pytest.mark.parametrize("error", [ClientError("busy", "later"), KeyError("loop")])
def test_it_asks_again_what_the_daemon_remembers_whatever_was_wrong(error, caplog):
    calls = []

    async def connected():
        calls.append(1)
        if len(calls) < 3:
            raise error

    async def main():
        link = BenchLink(FakeClient(), FakeClient)
        link._received_s += PATIENCE_S  # it publishes
        await kept(link, connected, lambda: len(calls) == 3)

    asyncio.run(main())
    assert ("connecting to the daemon" in caplog.text) == isinstance(error, KeyError)


@pytest.mark.parametrize("error", [ClientError("unreachable", "nobody"), ValueError("odd")])
def test_a_new_connection_takes_the_place_of_a_silent_one(error, monkeypatch):
    monkeypatch.setattr(bench_link, "RECONNECT_S", 0.0)
    first, made, taken = FakeClient(), [], []

    def connect():
        made.append(FakeClient())
        if len(made) < 3:
            raise error
        monkeypatch.setattr(bench_link, "RECONNECT_S", PATIENCE_S)
        return made[-1]

    async def main():
        link = BenchLink(first, connect)
        link._received_s -= 1.0  # silent
        link.start(taken.extend)
        await kept(link, None, lambda: first.closed)
        assert link.client is made[2]
        first.publish("old")
        made[2].publish("new")
        await until(lambda: taken)

    asyncio.run(main())
    assert taken == [("mesh", "new")]
    assert len(first.subscriptions) == 5
    assert all(one.closed for one in first.subscriptions.values())
    assert made[2].subscriptions.keys() == first.subscriptions.keys()
    assert not any(one.closed for one in made[2].subscriptions.values())


def test_a_new_connection_is_given_time_until_its_first_state(monkeypatch):
    """On a busy computer that is longer than until the next look: none ever came to one."""
    made, looks, now_s = [], [], [100.0]

    def monotonic():
        looks.append(now_s[0])
        return now_s[0]

    monkeypatch.setattr(bench_link, "time", SimpleNamespace(monotonic=monotonic))

    def connect():
        made.append(FakeClient())
        return made[-1]

    async def main():
        link = BenchLink(FakeClient(), connect)
        link.start(lambda items: None)
        now_s[0] += bench_link.RECONNECT_S + 0.1
        await kept(link, None, lambda: len(looks) > 60)
        assert link.client is made[0]
        assert len(made) == 1
        now_s[0] += bench_link.RECONNECT_S + 0.1
        await kept(link, None, lambda: len(made) == 2)

    asyncio.run(main())
