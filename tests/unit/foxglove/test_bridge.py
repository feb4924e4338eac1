"""The bridge against the daemon's own pieces and a viewer that knows the public protocol alone."""

import json
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from motord import config as bench_files
from motord.api.messages import Event
from motord.api.plan_messages import MeshView, PlanView
from motord.client import connect
from motord.foxglove import topics
from motord.foxglove.bridge import ViewerFeed, run, values_by_path
from motord.foxglove.server import FoxgloveError, FoxgloveServer
from motord.schema import TICK
from motord.service.publish.publisher import named_state as recorded_state
from tests.support.foxglove_client import Viewer
from tests.unit.foxglove.test_decimation import RATE_HZ, START_NS, ticks
from tests.unit.service.live_service import live_service

LEASE_S = 60.0
"""A client that a busy computer keeps from renewing stays in command."""


@pytest.fixture
def server():
    server = FoxgloveServer("motord test", 0)
    yield server
    server.stop()


@pytest.fixture(scope="module")
def bridged(tmp_path_factory):
    """A bench that is served: `live`, `server`, and what the bridge said."""
    with live_service(tmp_path_factory.mktemp("state"), zenoh={"lease_s": LEASE_S}) as live:
        server, said, stopping = FoxgloveServer("motord live", 0), [], threading.Event()
        thread = threading.Thread(
            target=run,
            args=(lambda: connect("live", live.listen), server, said.append, stopping),
        )
        thread.start()
        yield SimpleNamespace(live=live, server=server, said=said)
        stopping.set()
        thread.join()
        server.stop()


def in_any_second(times_ns):
    """Return how many messages are within a second at most."""
    times_ns = np.sort(times_ns)
    return int(
        (np.searchsorted(times_ns, times_ns + 10**9) - np.arange(len(times_ns))).max(initial=0)
    )


def test_topics_are_advertised_with_their_schemas(server):
    with Viewer(server.url) as viewer:
        wanted = {"/tick", "/tick_extremes", "/state", "/event", "/plan", "/mesh", "/bench"}
        viewer.receive_until(lambda: wanted <= viewer.channels.keys(), "topics")
        assert viewer.info["name"] == "motord test"
        assert viewer.info["capabilities"] == ["parameters", "parametersSubscribe"]  # no commands
        assert {t: c["schemaName"] for t, c in viewer.channels.items()} == {
            "/tick": "motord.Tick", "/tick_extremes": "motord.TickExtremes",
            "/state": "motord.State", "/event": "foxglove.Log", "/plan": "motord.Plan",
            "/mesh": "motord.Mesh", "/bench": "motord.BenchState",
        }  # fmt: skip


def test_ticks_at_10_kHz_come_decimated_and_a_spike_of_one_tick_comes_through(server):
    feed = ViewerFeed(server, RATE_HZ)
    block = ticks(2 * RATE_HZ)
    block["torque_Nm"][12_345] = 77.0
    block["i_c_A"][12_345] = -55.0
    with Viewer(server.url) as viewer:
        viewer.subscribe("/tick", "/tick_extremes")
        viewer.receive_until(lambda: server.wanted("/tick") and server.wanted("/tick_extremes"), "")
        for start in range(0, len(block), 500):
            feed.ticks(block[start : start + 500])
        got = [viewer.next("/tick_extremes") for _ in range(99)]
    assert in_any_second(np.array([message.t_ns for message in got])) <= 60
    assert sum(message.content.ticks for message in got) == 99 * 200
    assert max(message.content.max.torque_Nm for message in got) == 77.0
    assert min(message.content.min.i_c_A for message in got) == -55.0
    [spiked] = [m for m in got if m.content.max.torque_Nm == 77.0]
    assert spiked.content.t_start_ns <= block["t_ns"][12_345] <= spiked.content.t_ns == spiked.t_ns


def test_every_field_of_a_tick_is_the_daemons(server):
    feed = ViewerFeed(server, RATE_HZ)
    block = ticks(1000)
    rng = np.random.default_rng(3)
    for field in TICK.fields[2:]:
        if field.kind == "float":
            block[field.name] = rng.normal(size=1000)
        else:
            block[field.name] = rng.integers(-(2**31) if field.kind[0] == "s" else 0, 2**31, 1000)
    with Viewer(server.url) as viewer:
        viewer.subscribe("/tick")
        viewer.receive_until(lambda: server.wanted("/tick"), "a subscription")
        feed.ticks(block)
        for number in (199, 399, 599, 799):
            message = viewer.next("/tick")
            assert message.t_ns == block["t_ns"][number]
            for field in TICK.fields:
                assert getattr(message.content, field.name) == block[field.name][number], field


def test_a_plan_that_comes_before_any_tick_is_not_of_1970(server):
    with Viewer(server.url) as viewer:
        viewer.subscribe("/plan", "/mesh")
        viewer.receive_until(lambda: server.wanted("/plan") and server.wanted("/mesh"), "")
        before_ns = time.time_ns()
        feed = ViewerFeed(server, RATE_HZ)
        feed.plan(PlanView(plan="cogging", state="done", run_id="a"))
        feed.mesh(MeshView(plan="cogging", run_id="a", points_total=0, points=[]))
        feed.repeat()
        for topic in ("/plan", "/mesh", "/plan", "/mesh"):
            assert viewer.next(topic).t_ns >= before_ns
        feed.ticks(ticks(10))
        feed.repeat()
        assert viewer.next("/plan").t_ns == ticks(10)["t_ns"][-1]


def test_events_are_messages_of_the_log_panel(server):
    with Viewer(server.url) as viewer:
        viewer.subscribe("/event")
        viewer.receive_until(lambda: server.wanted("/event"), "a subscription")
        feed = ViewerFeed(server, RATE_HZ)
        feed.event(Event(t_ns=START_NS + 5, kind="trip", message="too fast", data={"a": 1}))
        feed.event(Event(t_ns=START_NS + 6, kind="state", message="READY"))
        trip, state = viewer.next("/event"), viewer.next("/event")
    assert trip.t_ns == START_NS + 5
    assert trip.content == {
        "t_ns": START_NS + 5, "kind": "trip", "message": "too fast", "data": {"a": 1},
        "timestamp": {"sec": START_NS // 10**9, "nsec": 5}, "level": 4, "name": "trip",
    }  # fmt: skip
    assert (state.content["level"], state.content["name"]) == (2, "state")


def test_the_state_comes_by_name_and_the_trip_too(bridged):
    with Viewer(bridged.server.url) as viewer, connect("live", bridged.live.listen) as client:
        viewer.subscribe("/state")
        first = viewer.next("/state")
        assert first.content["state"] == "OFF"
        assert first.t_ns == first.content["t_ns"]
        with client.lease("test") as lease:
            client.rpc("enable", token=lease.token)
            while (state := viewer.next("/state").content)["state"] != "ENABLED":
                pass
            assert state["holder"] == "test"
            client.rpc("stop")


def test_the_state_is_the_one_of_recordings(bridged):
    bench = bridged.live.bench
    with Viewer(bridged.server.url) as viewer, connect("live", bridged.live.listen) as client:
        viewer.subscribe("/state", "/bench")
        with client.lease("test") as lease:
            client.rpc("set", token=lease.token, speed_Hz=0.5)
            while (state := viewer.next("/state").content)["speed_Hz"] != 0.5:
                pass
            recorded = {**recorded_state(bench, bridged.live.now_ns), "t_ns": state["t_ns"]}
            assert state == recorded
        assert viewer.next("/bench").content["loop"]["rate_Hz"] == bridged.live.config.loop.rate_Hz


def test_the_rate_of_states_is_bounded_and_a_change_is_never_left_out(bridged):
    sent = []
    keep = SimpleNamespace(log=lambda topic, data, t_ns: sent.append((t_ns, json.loads(data))))
    feed = ViewerFeed(keep, RATE_HZ)
    with connect("live", bridged.live.listen) as client:
        state = client.state()
    for i in range(2000):  # a thousand a second
        name = "READY" if i == 1001 else "OFF"
        feed.state(state.model_copy(update={"t_ns": START_NS + i * 10**6, "state": name}))
    assert (
        40 <= in_any_second(np.array([t_ns for t_ns, content in sent if "loop" in content])) <= 60
    )
    assert "READY" in [content["state"] for _, content in sent]


def test_the_bench_file_is_there_as_parameters_that_nobody_can_change(bridged):
    config = bridged.live.config
    with Viewer(bridged.server.url) as viewer:
        viewer.receive_until(lambda: viewer.get_parameters(), "parameters")
        got = viewer.get_parameters("limits.torque_Nm", "bench.name", "motor.serial")
        assert got["limits.torque_Nm"] == config.limits.torque_Nm
        assert got["bench.name"] == "live"
        viewer.send(
            op="setParameters", id="set", parameters=[{"name": "limits.torque_Nm", "value": 1e9}]
        )
        viewer.receive_until(lambda: viewer.statuses, "why it is refused")
        assert "change them there" in viewer.statuses[-1]["message"]
        got = viewer.get_parameters("limits.torque_Nm")
        assert got == {"limits.torque_Nm": config.limits.torque_Nm}


def test_tables_in_lists_are_parameters_too_and_what_is_left_out_is_none(server):
    thermal = Path(__file__).parents[3] / "config" / "thermal.toml"
    bench = bench_files.load(thermal).model_dump(mode="json")
    server.set_parameters(dict(values_by_path(bench)))
    with Viewer(server.url) as viewer:
        got = viewer.get_parameters("channels.0.name", "channels.0.trip_below", "motor.pole_pairs")
    assert got == {"channels.0.name": "winding_C", "motor.pole_pairs": 8}


def test_commands_of_a_viewer_are_nothing_but_a_complaint(bridged):
    with Viewer(bridged.server.url) as viewer:
        viewer.send(
            op="advertise",
            channels=[{"id": 1, "topic": "/set", "encoding": "json", "schemaName": ""}],
        )
        viewer.receive_until(lambda: viewer.statuses, "a complaint")
        # what is passed on from now on is of after the complaint; what came before it may be older
        since_ns = bridged.live.now_ns
        viewer.subscribe("/state")
        while (state := viewer.next("/state")).t_ns <= since_ns:
            pass
        assert state.content["holder"] == ""


def test_a_port_that_is_taken_is_said():
    server = FoxgloveServer("one", 0)
    port = int(server.url.rpartition(":")[2])
    with pytest.raises(FoxgloveError, match=rf"port {port} of 127.0.0.1: .*in use.*--port"):
        FoxgloveServer("two", port)
    server.stop()


TYPES = ("object", "array", "string", "number", "integer", "boolean")


def test_schemas_have_no_forms_that_viewers_do_not_know():
    """Each has one type; arrays have items of a type; no references and no alternatives."""

    def check(schema, where):
        assert schema["type"] in TYPES, where
        assert not {"$ref", "$defs", "anyOf", "oneOf", "prefixItems"} & schema.keys(), where
        for name, item in schema.get("properties", {}).items():
            check(item, f"{where}.{name}")
        if schema["type"] == "array":
            check(schema["items"], where)

    for topic in topics.SERVED:
        if topic.encoding == "json":
            check(json.loads(topic.schema), topic.name)
