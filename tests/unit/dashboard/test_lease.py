"""The lease of a page: only its own answers renew it."""

import asyncio

import pytest

from motord.client import ClientError
from motord.dashboard.page.lease import PageLease
from tests.unit.dashboard.fake_link import LEASE_S, FakeLink


@pytest.fixture
def link():
    return FakeLink()


@pytest.fixture
def lease(link):
    return PageLease(link.call, "anna@bench page 1", lambda: None)


def run(work):
    return asyncio.run(work)


def test_it_is_acquired_in_the_name_of_the_page(lease, link):
    run(lease.acquire(force=False))
    assert lease.held
    assert 0 < lease.remaining_s <= LEASE_S
    assert lease.ping_s <= LEASE_S / 8
    assert link.named("lease/acquire") == [{"holder": "anna@bench page 1", "force": False}]


def test_two_pages_are_two_holders(lease, link):
    run(lease.acquire(force=False))
    other = PageLease(link.call, "anna@bench page 2", lambda: None)
    with pytest.raises(ClientError, match="page 1 is in command"):
        run(other.acquire(force=False))
    run(other.acquire(force=True))
    run(lease.renew())
    assert (lease.held, other.held) == (False, True)
    assert lease.why == "the lease is over"


def test_a_lease_that_nobody_renews_is_given_up(lease, monkeypatch):
    run(lease.acquire(force=False))
    late_s = lease._good_until_s + 0.01
    monkeypatch.setattr("motord.dashboard.page.lease.time.monotonic", lambda: late_s)
    lease.check()
    assert not lease.held
    assert "ran out" in lease.why


@pytest.mark.parametrize(("code", "held"), [("unreachable", True), ("no_lease", False)])
def test_a_daemon_that_does_not_answer_may_still_do_so_in_time(lease, link, code, held):
    run(lease.acquire(force=False))
    link.errors["lease/renew"] = ClientError(code, "why")
    run(lease.renew())
    assert lease.held is held
    assert lease.why == ("" if held else "why")


def test_closing_gives_it_back(lease, link):
    run(lease.acquire(force=False))
    token = lease.token
    run(lease.close())
    assert link.named("lease/release") == [{"token": token}]
    assert not lease.held


def test_closing_without_it_asks_for_nothing(lease, link):
    run(lease.close())
    assert link.calls == []


def test_a_page_that_closes_while_it_is_granted_gives_it_back(link):
    async def closed_meanwhile():
        granting = asyncio.Event()

        async def slow(name, /, **arguments):
            if name == "lease/acquire":
                await granting.wait()
            return await link.call(name, **arguments)

        lease = PageLease(slow, "anna@bench page 1", lambda: None)
        acquiring = asyncio.create_task(lease.acquire(force=False))
        await asyncio.sleep(0)
        await lease.close()
        granting.set()
        await acquiring
        return lease

    assert not run(closed_meanwhile()).held
    assert len(link.named("lease/release")) == 1


def test_asked_for_twice_it_is_acquired_once(link):
    async def twice():
        async def slow(name, /, **arguments):
            await asyncio.sleep(0)
            return await link.call(name, **arguments)

        lease = PageLease(slow, "anna@bench page 1", lambda: None)
        await asyncio.gather(lease.acquire(force=True), lease.acquire(force=True))
        return lease

    lease = run(twice())
    assert len(link.named("lease/acquire")) == 1
    assert lease.token == link.token


def test_a_renewal_that_is_never_answered_does_not_hold_up_the_next_lease(link):
    async def renewed():
        answers = []

        async def call(name, /, **arguments):
            if name == "lease/renew" and not answers:
                answers.append(asyncio.get_running_loop().create_future())
                await answers[0]
            return await link.call(name, **arguments)

        lease = PageLease(call, "anna@bench page 1", lambda: None)
        await lease.acquire(force=False)
        hanging = asyncio.create_task(lease.renew())
        await asyncio.sleep(0)
        lease.lose("it ran out")
        await lease.acquire(force=True)
        await lease.renew()
        good_until_s = lease._good_until_s
        answers[0].set_exception(ClientError("no_lease", "the first is over"))
        await hanging
        assert (lease.held, lease._good_until_s) == (True, good_until_s)
        return lease

    lease = run(renewed())
    assert link.named("lease/renew") == [{"token": lease.token}]
