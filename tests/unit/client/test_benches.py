"""All benches behind endpoints: who is there, who hangs, who has a name twice, who goes."""

import time

import pytest
import zenoh

from motord.api.endpoints import key
from motord.client import ClientError, connect
from motord.client import benches as benches_module
from motord.client.benches import Benches
from motord.client.roster import ANSWERED_S, SILENT_S, BenchRoster
from tests.support.patience import PATIENCE_S
from tests.support.played_benches import endpoint, played, router, state_of


def until(benches, condition, publishing=()):
    """Return the entries by name once they fulfil `condition`, while benches publish."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        for one in publishing:
            one.publish()
        found = {entry.bench: entry for entry in benches.entries()}
        if condition(found):
            return found
        benches.wait(0.05)
    raise AssertionError(f"it never came: {benches.entries()}")


def live(*names):
    def all_live(found):
        return found.keys() == set(names) and all(
            entry.alive and not entry.silent and entry.daemons == 1 for entry in found.values()
        )

    return all_live


def test_benches_of_two_routers_are_seen_from_each():
    with (
        played("a", "b", "c") as (a, b, c),
        router(c.listen) as (far, _),
        router(a.listen, b.listen, far) as (near, _),
    ):
        for listen in (near, far):
            with Benches([listen]) as benches:
                found = until(benches, live("a", "b", "c"), (a, b, c))
                assert found["b"].state == state_of("b")


def test_a_bench_that_goes_is_gone_and_comes_again():
    with (
        played("a", "b") as (a, b),
        router(a.listen, b.listen) as (listen, _),
        Benches([listen]) as benches,
    ):
        until(benches, live("a", "b"), (a, b))
        a.close()
        until(benches, live("b"), (b,))


def test_a_router_that_goes_takes_along_what_is_behind_it():
    with (
        played("a", "b") as (a, b),
        router(b.listen) as (far, far_session),
        router(a.listen, far) as (near, _),
        Benches([near]) as benches,
    ):
        until(benches, live("a", "b"), (a, b))
        far_session.close()
        until(benches, live("a"), (a,))


def test_several_endpoints_one_of_them_out_of_reach():
    with played("a", "b") as (a, b):
        nobody = endpoint()
        with Benches([a.listen, nobody, b.listen]) as benches:
            until(benches, live("a", "b"), (a, b))
            assert list(benches.unreachable) == [nobody]


def test_a_bench_that_hangs_is_silent_and_holds_up_nobody():
    with (
        played("a") as (a,),
        played("stuck", answers=False) as (stuck,),
        router(a.listen, stuck.listen) as (listen, _),
        Benches([listen]) as benches,
    ):
        found = until(
            benches,
            lambda found: found.keys() == {"a", "stuck"} and not found["a"].silent,
            (a,),
        )
        assert (found["stuck"].alive, found["stuck"].silent) == (True, True)
        assert found["stuck"].state is None


def test_a_connection_that_comes_after_the_end_is_closed(monkeypatch):
    """As of an endpoint that lets in only after the end has waited long enough."""
    opened = []
    real = benches_module.open_session

    def late(*who):
        followed.close()
        opened.append(real(*who))
        return opened[-1]

    with router() as (listen, _):
        followed = Benches([])
        monkeypatch.setattr(benches_module, "open_session", late)
        followed._reach(listen)
        assert opened[0].is_closed()


def test_an_old_daemon_without_a_token_is_found_by_its_state():
    with played("old", token=False) as (old,), Benches([old.listen]) as benches:
        found = until(benches, lambda found: found and not found["old"].silent, (old,))
        assert not found["old"].alive


def test_a_state_that_cannot_be_read_is_said():
    with played("odd", content=b'{"bench": "odd"}') as (odd,), Benches([odd.listen]) as benches:
        found = until(benches, lambda found: found and found["odd"].problem, (odd,))
        assert "not what the daemon says" in found["odd"].problem


def test_daemons_of_a_name_are_counted_once_all_have_answered(monkeypatch):
    monkeypatch.setattr("motord.client.benches.ANSWER_S", 10 * PATIENCE_S)
    with (
        played("a") as (quick,),
        played("a", answers=False) as (slow,),
        router(quick.listen, slow.listen) as (listen, session),
    ):
        end_s = time.monotonic() + PATIENCE_S
        while not slow.stuck:  # the router knows the way to both
            session.get(key("a", "state"), lambda _: None, target=zenoh.QueryTarget.ALL)
            assert time.monotonic() < end_s
            time.sleep(0.05)
        with Benches([listen]) as benches:
            found = until(benches, lambda found: found and found["a"].daemons == 1, (quick,))
            assert not found["a"].counted
            while not found["a"].counted:
                for query in tuple(slow.stuck):
                    query.reply(key("a", "state"), slow.content)
                slow.stuck.clear()  # that is all that is answered
                benches.wait(0.05)
                found = {entry.bench: entry for entry in benches.entries()}
                assert time.monotonic() < end_s
            assert found["a"].daemons == 2


def test_two_daemons_of_one_name_are_counted_and_commanded_by_their_own_endpoint_alone():
    with played("a", "a") as (one, other), router(one.listen, other.listen) as (listen, _):
        with Benches([listen]) as benches:
            until(benches, lambda found: found and found["a"].daemons == 2)
        with pytest.raises(ClientError, match=r"2 daemons at .* have the name 'a'") as caught:
            connect("a", listen)
        assert caught.value.code == "refused"
        connect("a", one.listen).close()


def test_one_daemon_by_two_ways_is_one():
    with (
        played("a") as (a,),
        router(a.listen) as (listen, _),
        Benches([a.listen, listen]) as benches,
    ):
        found = until(benches, live("a"), (a,))
        assert found["a"].daemons == 1


def test_events_of_all_benches_come_with_their_name():
    received = []
    with (
        played("a", "b") as (a, b),
        router(a.listen, b.listen) as (listen, _),
        Benches([listen], on_event=lambda *event: received.append(event)) as benches,
    ):
        until(benches, live("a", "b"), (a, b))

        def both_came(found):  # what is published before the subscription is known there is lost
            a.publish_event(b'{"t_ns": 5, "kind": "note", "message": "of a"}')
            b.publish_event(b"nonsense")
            return received and found["b"].problem

        until(benches, both_came)
    assert {(bench, event.message) for bench, event in received} == {("a", "of a")}


def test_the_roster_counts_time():
    roster, state = BenchRoster(), state_of("a")
    roster.token("a", "x", there=True)
    [entry] = roster.entries(10.0)
    assert (entry.alive, entry.silent, entry.age_s, entry.state) == (True, True, None, None)
    roster.published("a", state, 10.0)
    assert not roster.entries(10.0 + SILENT_S)[0].silent
    assert roster.entries(10.1 + SILENT_S)[0].silent
    roster.token("a", "y", there=True)
    roster.token("a", "x", there=False)
    assert roster.entries(20.0)[0].alive  # by another way
    roster.token("a", "y", there=False)
    assert roster.entries(10.0) == []  # its last state counts no more
    roster.answered("a", "id", state, 30.0)
    assert roster.entries(30.0 + ANSWERED_S)[0].daemons == 1
    assert roster.entries(30.1 + ANSWERED_S) == []
