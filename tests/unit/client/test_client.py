"""The client against the daemon's own pieces, over Zenoh on loopback."""

import json
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import zenoh

from motord.api.endpoints import client_config, router_config
from motord.api.requests import LEASE_RENEW, RPCS, STOP
from motord.client import (
    Client,
    ClientError,
    Lease,
    PlanEndedError,
    connect,
    connection,
    operator,
)
from motord.client.discovery import why_no_endpoint
from motord.schema import TICK_DTYPE
from motord.security.identity import Identity
from motord.service.publish.zenoh_api import ApiError
from tests.support.panic import panic
from tests.support.patience import PATIENCE_S
from tests.unit.service.live_service import LiveService, endpoint, live_service

LONG = {"torques_Nm": [1.0], "speeds_Hz": [1.0], "turns": 1000, "gain_steps": []}
"""Over only when it is aborted."""


@pytest.fixture
def client(live):
    with connect("live", live.listen) as client:
        yield client


def wait_for(states, condition):
    for _ in range(round(PATIENCE_S * 10)):
        state = states.get(PATIENCE_S)
        assert state is not None
        if condition(state):
            return state
    raise AssertionError("it never came")


def code_of(client, name, /, **arguments):
    with pytest.raises(ClientError) as caught:
        client.rpc(name, **arguments)
    return caught.value.code


def test_nobody_there_is_said_in_one_line():
    where = endpoint()
    with pytest.raises(ClientError) as caught:
        connect("x", where)
    assert (
        str(caught.value) == f"no motord at {where} for bench 'x': is `motord run` running there?"
    )
    assert caught.value.code == "unreachable"


@pytest.mark.parametrize(
    "where",
    [
        "127.0.0.1:1",
        "tcp/127.0.0.1",
        "tcp:127.0.0.1:1",
        "tcp/127.0.0.1:1,tcp/127.0.0.1:2",
        "localhost/7447",
        "tcpp/localhost:7447",
    ],
)
def test_what_is_no_endpoint_is_named_rather_than_a_daemon_missed(where):
    with pytest.raises(ClientError, match="is no endpoint; those are tcp/HOST:PORT") as caught:
        connect(None, where)
    assert caught.value.code == "unreachable"


@pytest.mark.parametrize(
    "where",
    ["tcp/[::1]:7447", "tcp/localhost:7447#iface=lo", "tls/host:7447?rel=1", "udp/host:1",
     "quic/host:1", "unixsock-stream//run/motord.sock"],
)  # fmt: skip
def test_whatever_zenoh_connects_to_is_an_endpoint(where):
    assert why_no_endpoint(where) == ""


def test_another_zenoh_router_is_no_daemon():
    where = endpoint()
    with zenoh.open(router_config([where])), pytest.raises(ClientError, match="no motord"):
        connect(None, where)


def test_a_connection_that_is_over_is_said_by_whatever_is_asked(live):
    client = connect("live", live.listen)
    client.close()
    asks = (client.state, client.subscribe_state, client.subscribe_ticks, client.lease().acquire)
    for ask in asks:
        with pytest.raises(ClientError) as caught:
            ask()
        assert caught.value.code == "unreachable"


def test_who_is_cut_off_while_it_looks_for_the_bench_finds_nobody(live, monkeypatch):
    def cut_off(*_):
        raise zenoh.ZError("session closed")

    monkeypatch.setattr("motord.client.discovery._find_bench", cut_off)
    with pytest.raises(ClientError, match="no motord at"):
        connect("live", live.listen)


def test_a_wrong_name_is_answered_with_those_there_are(live):
    with pytest.raises(ClientError, match="bench 'other'; there is one for: live"):
        connect("other", live.listen)


def test_the_only_bench_needs_no_name(live):
    with connect(None, live.listen) as client:
        assert client.bench == "live"
        client.close()


def test_state_and_ticks_arrive(client):
    with client.subscribe_state() as states:
        assert wait_for(states, lambda s: s.tick is not None).bench == "live"
    assert client.state().state == "OFF"
    with client.subscribe_ticks() as blocks:
        first, second = blocks.get(PATIENCE_S), blocks.get(PATIENCE_S)
    assert first.dtype == TICK_DTYPE
    numbers = np.concatenate([first, second])["tick"]
    assert np.array_equal(np.diff(numbers), np.ones(len(numbers) - 1))


def test_callbacks_get_what_subscriptions_get(client):
    seen = threading.Event()
    with client.subscribe_state(lambda state: seen.set()):
        assert seen.wait(PATIENCE_S)


def test_a_subscription_is_iterated(client):
    with client.subscribe_ticks() as blocks:
        for block in blocks:
            assert len(block)
            break


def test_single_ticks_are_plain_protobuf(live):
    arrived = threading.Event()
    encodings = []

    def receive(sample):
        encodings.append((str(sample.encoding), len(sample.payload)))
        arrived.set()

    with zenoh.open(client_config(live.listen)) as session:
        session.declare_subscriber("motord/live/tick", receive)
        assert arrived.wait(PATIENCE_S)
    assert encodings[0][0] == "application/protobuf;motord.Tick"


def test_a_lease_commands_and_is_renewed(live, client):
    with client.subscribe_state() as states, client.lease("anna") as lease:
        assert client.rpc("enable", token=lease.token) == {"state": "ENABLED"}
        answer = client.rpc("set", token=lease.token, torque_Nm=1.0, speed_Hz=0.5)
        assert answer["setpoint"]["torque_Nm"] in (0.0, 1.0)
        state = wait_for(states, lambda s: s.uptime_s > client.state().uptime_s - 1.0)
        end_s = state.uptime_s + 2.5 * live.bench.lease.duration_ns / 1e9
        state = wait_for(states, lambda s: s.uptime_s > end_s)
        assert (state.state, state.lease.holder) == ("ENABLED", "anna")
        assert not lease.lost.is_set()
    with client.subscribe_state() as states:
        wait_for(states, lambda s: s.state == "READY" and s.lease.holder is None)
    client.rpc("stop")


def test_a_second_commander_is_refused_and_a_takeover_is_noticed(client):
    with client.lease("anna") as lease:
        with pytest.raises(ClientError, match="anna is in command"):
            client.lease("ben").acquire()
        with client.lease("ben", force=True) as other:
            assert other.took_over_from == "anna"
            assert lease.lost.wait(PATIENCE_S)
            assert "ben took over" in lease.why
        assert code_of(client, "enable", token=lease.token) == "no_lease"
    assert operator()


class Flaky:
    """A daemon that `lease/renew` does not reach the first `failures` times, or is refused by."""

    def __init__(self, failures, code="unreachable", lease_s=0.4):
        self.failures, self.code, self.lease_s = failures, code, lease_s
        self.renewed = threading.Event()

    def call(self, rpc, /, **arguments):
        if rpc.name == "lease/renew":
            if self.failures:
                self.failures -= 1
                raise ClientError(self.code, "it is gone")
            self.renewed.set()
        grant = {"token": "t", "took_over_from": None, "lease_s": self.lease_s}
        return rpc.reply.model_validate({**grant, "renew_within_s": 0.3})


def test_a_lease_outlives_a_connection_that_comes_back_in_time():
    daemon = Flaky(failures=2, lease_s=PATIENCE_S)
    with Lease(daemon, "anna") as lease:
        assert daemon.renewed.wait(PATIENCE_S)
        assert not lease.lost.is_set()


@pytest.mark.parametrize(("code", "lease_s"), [("unreachable", 0.4), ("no_lease", 2 * PATIENCE_S)])
def test_a_lease_is_lost_at_once_when_it_is_refused_or_the_daemon_stays_away(code, lease_s):
    with Lease(Flaky(failures=10**9, code=code, lease_s=lease_s), "anna") as lease:
        assert lease.lost.wait(PATIENCE_S)
        assert lease.why == "it is gone"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_lease_is_lost_when_a_panic_ends_its_renewal():
    class Panicking(Flaky):
        def call(self, rpc, /, **arguments):
            return panic() if rpc.name == "lease/renew" else super().call(rpc, **arguments)

    with Lease(Panicking(0), "anna") as lease:
        assert lease.lost.wait(PATIENCE_S)
        assert lease.why == "it is not renewed any more: PanicError: of a library in Rust"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_lease_is_lost_when_what_it_is_renewed_for_fails():
    with Lease(Flaky(0), "anna", alive=lambda: 1 / 0) as lease:
        assert lease.lost.wait(PATIENCE_S)
        assert lease.why == "it is not renewed any more: ZeroDivisionError: division by zero"


def test_a_lease_can_be_acquired_again_and_is_renewed_again():
    daemon = Flaky(failures=0)
    lease = Lease(daemon, "anna")
    for _ in range(2):
        with lease:
            assert daemon.renewed.wait(PATIENCE_S)
        daemon.renewed.clear()
    daemon.code, daemon.failures = "no_lease", 10**9
    with lease:
        assert lease.lost.wait(PATIENCE_S)
    daemon.failures = 0
    with lease:
        assert (lease.lost.is_set(), lease.why) == (False, "")


def test_a_renewal_without_an_answer_is_given_up_in_time(live, client, monkeypatch):
    asked = {}
    monkeypatch.setattr(
        client, "ask", lambda name, given, timeout_s: asked.update({name: timeout_s}) or b"{}"
    )
    for rpc in (LEASE_RENEW, STOP):
        with suppress(ClientError):
            client.call(rpc, token="t")
    assert asked == {"rpc/lease/renew": connection.QUERY_S, "rpc/stop": connection.REPLY_S}
    assert live.bench.lease.duration_ns >= connection.QUERY_S * 1e9


def test_numbers_of_numpy_are_sent_as_numbers(live, client):
    with client.lease("anna") as lease:
        reply = lease.set(torque_Nm=np.float32(0.5), speed_Hz=np.float64(0.5), enable=np.True_)
        assert reply.setpoint.torque_target_Nm == 0.5
        lease.disable()
    outline = client.dry_run("cogging", {"speeds_Hz": np.array([0.5, 1.0]), "turns": np.int64(2)})
    assert [point["turns"] for point in outline.points] == [2, 2]
    with pytest.raises(TypeError, match="cannot be sent"):
        client.rpc("set", torque_Nm=1j)


def test_a_lease_that_cannot_be_given_back_is_lost(client):
    lease = client.lease("anna")
    lease.acquire()
    client.rpc("lease/release", token=lease.token)
    lease.release()
    assert lease.lost.is_set()


def test_refusals_carry_code_and_message(client):
    assert code_of(client, "set", token="x", torque_Nm=1) == "no_lease"
    assert code_of(client, "set", token="x", torque=1) == "invalid"
    assert code_of(client, "plan/start", name="dance", dry_run=True) == "invalid"
    assert code_of(client, "dance") == "unknown"


@pytest.mark.parametrize("name", sorted(RPCS))
@pytest.mark.parametrize(
    "payload", [b"", b"\xff\xfe", b"[]", b'{"token": 1}', b'{"a": NaN}', b"{" * 900]
)
def test_whatever_comes_in_is_answered_with_json(live, name, payload):
    with zenoh.open(client_config(live.listen)) as session:
        [reply] = session.get(f"motord/live/rpc/{name}", payload=payload, timeout=PATIENCE_S)
    content = (reply.ok or reply.err).payload.to_bytes()
    if reply.err is not None:
        assert json.loads(content).keys() == {"code", "message"}
    else:
        assert (payload, name) in [
            (b"", n) for n in ("stop", "plan/list", "config", "calibration/list", "queue/list")
        ]


def test_a_wildcard_commands_nothing(live, client):
    before = len(client.events())
    with zenoh.open(client_config(live.listen)) as session:
        for wide in ("**", "motord/live/**", "motord/*/rpc/stop", "motord/live/rpc/*"):
            assert list(session.get(wide, timeout=PATIENCE_S)) == []
        [state] = session.get("motord/*/state", timeout=PATIENCE_S)
        assert (str(state.ok.key_expr), json.loads(bytes(state.ok.payload))["bench"]) == (
            "motord/live/state", "live",
        )  # fmt: skip
    assert len(client.events()) == before


def test_a_subscriber_that_does_not_read_keeps_the_newest(client, monkeypatch):
    monkeypatch.setattr("motord.client.subscription.KEPT", 2)
    with client.subscribe_state() as states, client.subscribe_state() as watched:
        while states.lost < 2:
            assert watched.get(PATIENCE_S) is not None
        assert states.get(PATIENCE_S).t_ns > 0


def test_events_are_remembered_and_published(client):
    with client.subscribe_events() as coming:
        client.rpc("stop", by="a test")
        while coming.get(PATIENCE_S).message != "stop, from a test":
            pass
    assert any(event.message == "stop, from a test" for event in client.events())


def test_the_last_state_and_progress_come_at_once(client):
    with client.subscribe_state() as states, client.subscribe_state(latest=False) as later:
        first = states.get(0.0)
        assert first.bench == "live"
        assert later.get(PATIENCE_S).t_ns >= first.t_ns
    with client.subscribe_plan() as progress:
        present, first = client.plan(), progress.get(0.0)
        assert (first is None) == (present is None)


def test_a_subscription_without_a_daemon_waits_for_it(tmp_path):
    with live_service(tmp_path, name="short") as service:
        client = connect("short", service.listen)
    with client, client.subscribe_state() as states:
        assert states.get(0.0) is None


def test_a_lease_has_what_its_holder_may_ask_for(client):
    client.stop(by="a test")
    with client.lease("anna") as lease, client.subscribe_state() as states:
        assert lease.reset().state in ("OFF", "READY")
        assert lease.enable().state == "ENABLED"
        reply = lease.set(torque_Nm=0.5, speed_Hz=0.5, compensate="off")
        assert (reply.setpoint.torque_target_Nm, reply.setpoint.speed_Hz) == (0.5, 0.5)
        assert wait_for(states, lambda s: s.setpoint.torque_target_Nm == 0.5).state == "ENABLED"
        assert lease.disable().state == "READY"
        assert lease.set(enable=True, brake=0.0).state == "ENABLED"
        with pytest.raises(ClientError, match="nothing to set"):
            lease.set()
        assert client.stop().state == "OFF"
    with pytest.raises(ClientError) as caught:
        lease.enable()
    assert caught.value.code == "no_lease"
    assert any(operator() in event.message for event in client.events())


def test_what_needs_no_lease(client):
    assert "calibrate" in [plan.name for plan in client.plans()]
    outline = client.dry_run("calibrate", LONG)
    assert (len(outline.points), outline.run_id) == (1, "")
    assert client.config().toml == "the text"
    with pytest.raises(ClientError, match="turns") as caught:
        client.dry_run("calibrate", {"turns": 0})
    assert caught.value.code == "invalid"


def test_a_plan_is_followed_to_its_end(client):
    client.stop()
    with client.lease("anna") as lease:
        run = lease.run_plan("calibrate", LONG)
        times_ns = []

        def abort_after_a_while():
            for progress in run:
                times_ns.append(progress.t_ns)
                if len(times_ns) == 3:
                    assert lease.pause_plan().state == "pausing"
                    assert lease.resume_plan().state == "running"
                    lease.abort_plan()

        with pytest.raises(PlanEndedError, match="calibrate aborted: aborted by anna"):
            abort_after_a_while()
        assert len(times_ns) > 3
        assert times_ns == sorted(times_ns)
        with pytest.raises(PlanEndedError):
            client.follow_plan().wait()
        again = client.follow_plan().run_id
        assert again == run.run_id
        outline = lease.start_plan("calibrate", LONG)
        assert outline.run_id != again
        with pytest.raises(ClientError, match="not known here any more"):
            run.wait()
        lease.abort_plan()
        with pytest.raises(PlanEndedError):  # or the next test finds it under way
            client.follow_plan().wait()


def test_plan_progress_is_published(client):
    with client.lease("anna") as lease, client.subscribe_plan(latest=False) as progress:
        outline = client.rpc("plan/start", token=lease.token, name="calibrate", settings=LONG)
        assert len(outline["points"]) == 1
        view = progress.get(PATIENCE_S)
        assert (view.plan, view.state, view.started_by) == ("calibrate", "running", "anna")
        assert client.plan().plan == "calibrate"
        client.rpc("plan/abort", token=lease.token)
        while not view.over:
            view = progress.get(PATIENCE_S)
        assert view.message == "aborted by anna"


def test_two_daemons_at_one_place_cannot_be(live, tmp_path):
    second = LiveService(tmp_path, live.listen, bench={"name": "second"})
    address = live.listen.removeprefix("tcp/")
    with pytest.raises(ApiError, match=rf"cannot listen there \({address}: Address already in use"):
        second.api.open([live.listen])
    second.api.close()


def test_a_daemon_that_went_away_is_noticed(tmp_path):
    with live_service(tmp_path, name="brief") as service:
        client = connect("brief", service.listen)
        client.state()
    with client, pytest.raises(ClientError, match="gone"):
        client.rpc("stop")
    with pytest.raises(ClientError, match="over"):
        client.rpc("stop")


def test_a_supervisor_that_does_not_answer_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr("motord.service.rpc.outstanding.REPLY_S", 0.2)
    with live_service(tmp_path, name="asleep") as service:
        service.paused.set()
        with connect("asleep", service.listen) as client:
            assert code_of(client, "stop") == "busy"
            monkeypatch.setattr("motord.service.rpc.outstanding.REPLY_S", 1e6)  # not even that
            monkeypatch.setattr("motord.client.connection.REPLY_S", 0.05)
            assert code_of(client, "stop") == "unreachable"


@pytest.fixture
def opening():
    """A gateway that has just opened: it knows that the daemon is alive, and no RPC of it."""
    where = endpoint()
    with zenoh.open(router_config([where])) as gateway:
        token = gateway.liveliness().declare_token("motord/gated/alive")
        state = gateway.declare_queryable(
            "motord/gated/state", lambda query: query.reply(query.key_expr, b"{}"), complete=True
        )
        yield where, gateway
        del token, state


def through(where, role):
    return Client(zenoh.open(client_config(where)), "gated", where, Identity(Path(), "anna", role))


def test_a_command_waits_for_a_gateway_that_has_just_opened_and_is_sent_once(opening, monkeypatch):
    where, gateway = opening
    taken, declared, matches = [], [], connection._matches

    def stop(query):
        taken.append(str(query.key_expr))
        query.reply(query.key_expr, b'{"state": "OFF"}')

    def learning(querier):
        """Look for the way, which the gateway learns after the first look."""
        found = matches(querier)
        if not declared:
            assert not found
            key = "motord/gated/rpc/stop"
            declared.append(gateway.declare_queryable(key, stop, complete=True))
        return found

    monkeypatch.setattr(connection, "ROUTE_S", PATIENCE_S)
    monkeypatch.setattr(connection, "_matches", learning)
    with through(where, "operator") as client:
        assert client.rpc("stop") == {"state": "OFF"}
        assert len(taken) == 1


@pytest.mark.parametrize(("role", "looks"), [("operator", True), ("viewer", False)])
def test_only_who_may_command_waits_for_the_way(opening, monkeypatch, role, looks):
    where, _ = opening
    looked, matches = [], connection._matches
    monkeypatch.setattr(connection, "ROUTE_S", 0.0)
    monkeypatch.setattr(connection, "_matches", lambda one: looked.append(one) or matches(one))
    with through(where, role) as client:
        for name in ("stop", "reset"):
            with pytest.raises(ClientError, match="not permitted for anna") as caught:
                client.rpc(name)
            assert caught.value.code == "forbidden"
    assert bool(looked) is looks


def test_a_stop_does_not_wait_for_the_way(opening, monkeypatch):
    where, gateway = opening
    monkeypatch.setattr(connection, "_matches", None)  # nobody looks
    reply = b'{"state": "OFF"}'
    queryable = gateway.declare_queryable(
        "motord/gated/rpc/stop", lambda query: query.reply(query.key_expr, reply), complete=True
    )
    with through(where, "operator") as client:
        assert client.rpc("stop") == {"state": "OFF"}
    queryable.undeclare()


@pytest.mark.parametrize(("reply_s", "code"), [(0.0, "unreachable"), (1e6, "busy")])
def test_no_reply_at_once_differs_from_none_in_time(tmp_path, monkeypatch, reply_s, code):
    """Zenoh's end of a query that timed out does not always say so."""
    monkeypatch.setattr(connection, "REPLY_S", reply_s)
    monkeypatch.setattr(Client, "_query", lambda *query: [])
    with live_service(tmp_path, name="mute") as service, connect("mute", service.listen) as client:
        assert code_of(client, "stop") == code
