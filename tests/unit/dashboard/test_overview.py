"""The overview: who is there, who has vanished and when, and what its pages get."""

import math
from pathlib import Path

from motord.api.messages import RecordingView, TripView
from motord.client.roster import BenchEntry
from motord.dashboard.app import application
from motord.dashboard.overview import bench_list
from motord.dashboard.overview.bench_list import BenchList
from motord.dashboard.overview.overview_pages import OverviewPages, command_for
from motord.dashboard.tokens import Tokens
from motord.security.roles import Role
from tests.support.played_benches import state_of
from tests.unit.dashboard.fake_link import FakeLink
from tests.unit.dashboard.test_app import HOST, ORIGIN, TestClient, receive, send


def entry(bench, *, age_s=0.1, endpoint="tcp/127.0.0.1:7447", **state):
    return BenchEntry(bench, state_of(bench, **state), age_s, True, 1, "", endpoint)


def names(shown):
    return [(one["bench"], one["gone_ns"]) for one in shown]


def test_who_vanishes_stays_with_the_time_until_it_comes_again():
    benches = BenchList(command_for(None))
    assert names(benches.update([entry("b"), entry("a")], 1)) == [("a", None), ("b", None)]
    shown = benches.update([entry("b")], 2)
    assert names(shown) == [("a", 2), ("b", None)]
    assert shown[0]["state"]["state"] == "OFF"
    assert names(benches.update([entry("b")], 3)) == [("a", 2), ("b", None)]
    assert names(benches.update([entry("a")], 4)) == [("a", None), ("b", 4)]


def test_benches_that_have_vanished_are_not_kept_without_end(monkeypatch):
    monkeypatch.setattr(bench_list, "VANISHED_MAX", 2)
    benches = BenchList(command_for(None))
    for n in range(5):
        shown = benches.update([entry(f"rig-{n}")], n)
    assert names(shown) == [("rig-2", 3), ("rig-3", 4), ("rig-4", None)]


def test_a_trip_has_its_reason_and_what_to_do_and_a_recording_its_name():
    trips = [TripView(name="OVER_CURRENT", meaning="above the limit")]
    recording = RecordingView(recording=True, path="/runs/a-1.mcap.part")
    tripped = {"state": "TRIPPED", "trips": trips, "first_trip": "OVER_CURRENT"}
    [shown] = BenchList(command_for(None)).update([entry("a", **tripped, recording=recording)], 1)
    state = shown["state"]
    assert state["trips"] == [{"name": "OVER_CURRENT", "meaning": "above the limit"}]
    assert "phase currents" in state["action"]
    assert state["recording_name"] == "a-1.mcap.part"
    [shown] = BenchList(command_for(None)).update([entry("a", first_trip="OF_A_LATER_VERSION")], 1)
    assert shown["state"]["action"] == ""
    [shown] = BenchList(command_for(None)).update([BenchEntry("a", None, None, True, 0)], 1)
    assert (shown["state"], shown["silent"]) == (None, True)


def test_the_command_for_a_bench_can_be_pasted():
    command = command_for(Path("/my keys/anna"))(entry("rig 1; rm x"))
    assert command == (
        "motord dashboard --port 0 --bench 'rig 1; rm x' --connect tcp/127.0.0.1:7447 "
        "--identity '/my keys/anna'"
    )


def test_a_page_gets_all_benches_and_what_it_asks_for_is_not_done():
    tokens, link = Tokens(Role.VIEWER), FakeLink()
    pages = OverviewPages(BenchList(command_for(None)), lambda: ["cannot reach x"])
    app = application(pages, tokens, link, "benches.html")
    with TestClient(app, base_url=f"http://{HOST}") as client:
        assert 'src="benches.js"' in client.get("/").text
        assert "script-src 'self'" in client.get("/").headers["content-security-policy"]
        client.portal.call(link.take, [entry("a")])
        protocols = ["motord.1", tokens.viewer]
        with client.websocket_connect(
            f"ws://{HOST}/socket", subprotocols=protocols, headers=ORIGIN
        ) as socket:
            data = receive(socket, "benches")[0]["data"]
            assert (names(data["benches"]), data["unreachable"]) == (
                [("a", None)],
                ["cannot reach x"],
            )
            send(socket, kind="rpc", id=1, name="stop", arguments={})
            client.portal.call(link.take, [entry("a"), entry("b", age_s=math.nan)])
            shown = receive(socket, "benches")[0]["data"]["benches"]
            assert names(shown) == [("a", None), ("b", None)]
            assert shown[1]["age_s"] is None  # browsers do not read NaN
    assert link.calls == []
