"""What the supervisor asks of the recorder at a trip, and what it does with the answer."""

import json
from pathlib import Path

import pytest

from motord.schema import State, Trip
from motord.service.bench.blackbox import ASKED_MAX
from tests.unit.service.played_daemon import PlayedDaemon


@pytest.fixture
def played(tmp_path, monkeypatch):
    daemon = PlayedDaemon(tmp_path, monkeypatch, recording={"auto": False})
    daemon.up()
    daemon.recorders[0].received()
    yield daemon
    daemon.close()


def trip(played, trips=Trip.OVER_SPEED, number=1):
    """Let the loop trip, and return what the recorder received of it."""
    slot = played.loops[-1].ring.slot()[0]
    slot["trip_bits"], slot["first_trip"], slot["t_ns"] = trips, trips & -trips, 10**15 * number
    slot["tick"], slot["state"], slot["speed_rad_s"] = played.loops[-1].number, State.TRIPPED, 99.0
    played.loops[-1].number += 1
    played.loops[-1].ring.publish()
    played.supervisor.step()
    return played.recorders[-1].received()


def events(played, kind):
    return [e for e in played.supervisor.bench.events.recent() if e.kind == kind]


def test_at_a_trip_a_box_is_asked_for_even_if_nothing_is_recorded(played):
    played.step(5, State.ENABLED)
    [asked, forwarded] = trip(played, Trip.OVER_SPEED | Trip.BUS_OFF)
    rate_Hz = played.config.loop.rate_Hz
    assert asked["do"] == "blackbox"
    assert (asked["tick"], asked["ticks_before"], asked["ticks_after"]) == (
        played.loops[0].number - 1, 10 * rate_Hz, rate_Hz,
    )  # fmt: skip
    path = Path(asked["path"])
    assert path.parent == played.folder / "runs" / "blackbox"
    account = asked["account"]
    assert (account["first"], account["causes"]) == (["OVER_SPEED"], ["OVER_SPEED", "BUS_OFF"])
    assert account["values"] == {
        "speed, rad/s": {"value": 99.0, "limit": 25.0},
        "off the bus, for s": {"value": 0.0, "limit": 0.0},
    }
    assert "brake" in account["action"]
    assert asked["metadata"]["config"] == "the text"
    assert (forwarded["do"], forwarded["content"]["kind"]) == ("blackbox_event", "trip")
    [event] = events(played, "trip")
    assert event.data["blackbox"] == str(path)
    assert event.data["action"] == account["action"]


def test_what_became_of_it_is_an_event_once(played):
    [asked, _] = trip(played)
    for _ in range(2):
        played.recorders[0].report(blackboxes={asked["path"]: "", "another": "x"})
        played.step()
    [event] = events(played, "blackbox")
    assert event.message == f"black box: {asked['path']}"
    played.step(2, State.READY)
    [asked, *_] = [c for c in trip(played, number=2) if c["do"] == "blackbox"]
    played.recorders[0].report(blackboxes={asked["path"]: "disk full"})
    played.step()
    assert events(played, "blackbox")[-1].message == "no black box of the trip: disk full"


def test_a_recorder_that_died_over_a_box_is_followed_by_one_that_is_asked_again(played):
    [asked, event] = trip(played)
    played.recorders[0].code = -9
    played.step(40)
    [again] = played.recorders[1].received("blackbox")
    assert {**again, "events": []} == {**asked, "events": []}
    assert event["content"] in again["events"]


def test_a_box_without_a_recorder_is_asked_for_when_there_is_one(played):
    played.recorders[0].code = -9
    played.step()
    slot = played.loops[0].ring.slot()[0]
    slot["state"], slot["trip_bits"], slot["first_trip"] = State.TRIPPED, 1, 1
    slot["tick"] = played.loops[0].number
    played.loops[0].number += 1
    played.loops[0].ring.publish()
    played.supervisor.step()
    played.step(40, State.TRIPPED)
    [asked] = played.recorders[1].received("blackbox")
    assert asked["account"]["first"] == ["OVER_CURRENT"]


def test_a_recorder_that_never_answers_is_not_asked_for_more_and_more(played):
    for number in range(ASKED_MAX + 3):
        trip(played, number=number + 1)
        played.step(1, State.READY)
    played.recorders[0].code = -9
    played.step(40)
    assert len(played.recorders[1].received("blackbox")) == ASKED_MAX


@pytest.mark.parametrize("state", [State.OFF, State.ENABLED])
def test_a_loop_that_dies_leaves_a_box(played, state):
    played.step(5, state)
    played.loops[0].code = -9
    played.step()
    [asked] = played.recorders[0].received("blackbox")
    assert (asked["tick"], asked["ticks_after"]) == (None, 0)
    account = asked["account"]
    assert (account["cause"], account["state"]) == ("loop died", state.name)
    assert "SIGKILL" in account["reason"]
    assert events(played, "blackbox")[0].data["path"] == asked["path"]
    assert json.dumps(asked)


def test_a_loop_that_dies_tripped_or_before_its_first_tick_leaves_none(played, tmp_path):
    trip(played)
    played.loops[0].code = -9
    played.step()
    assert played.recorders[0].received("blackbox") == []
    token = played.ask("lease/acquire", holder="anna")["token"]
    played.bring("reset", token=token)
    played.step(0)
    played.supervisor.step()
    played.loops[1].fail("no device")
    played.supervisor.step()
    assert played.recorders[0].received("blackbox") == []
