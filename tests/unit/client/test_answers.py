"""A program that pretends to be the daemon: whatever it says, a client ends with one error."""

import json
import logging
import math
import threading
import time
from contextlib import suppress

import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.api.endpoints import MAX_REPLY_BYTES, router_config
from motord.api.requests import MAX_REQUEST_BYTES, RPCS
from motord.client import Client, ClientError, connect
from motord.client.decoding import (
    decode_event,
    decode_events,
    decode_mesh,
    decode_mesh_or_none,
    decode_plan,
    decode_plan_or_none,
    decode_reply,
    decode_state,
    decode_ticks,
)
from tests.support.patience import PATIENCE_S
from tests.unit.service.live_service import endpoint

ROOT = "motord/false"
PAYLOADS = (
    b"", b"null", b"[]", b"{}", b"[[]]", b'"x"', b"\xff\xfe", b"{" * 900, b"[" * 100_000, b"NaN",
    b'{"token": 1}', b'{"code": 7}', b'{"state": null}', b'{"state": {"a": [1e999]}}',
    b'{"token": "x", "lease_s": -1, "renew_within_s": NaN, "took_over_from": 3}',
)  # fmt: skip


class FalseDaemon:
    """Has the port and the token, and says what it is told to."""

    def __init__(self):
        self.where = endpoint()
        self.replies = lambda query: query.reply(query.key_expr, b"{}")
        self.session = zenoh.open(router_config([self.where]))
        self.token = self.session.liveliness().declare_token(f"{ROOT}/alive")
        for name in ("rpc/**", "state", "event", "plan", "mesh"):
            self.session.declare_queryable(f"{ROOT}/{name}", self._answer, complete=True)

    def _answer(self, query):
        with query:
            self.replies(query)


@pytest.fixture(scope="module")
def false_daemon():
    made = FalseDaemon()
    yield made
    made.session.close()


@pytest.fixture
def client(false_daemon):
    with connect(None, false_daemon.where) as client:
        yield client


WITH_FIELDS = sorted(name for name, rpc in RPCS.items() if rpc.reply.model_fields)
ASKS = {
    **{name: lambda client, name=name: client.rpc(name) for name in WITH_FIELDS},
    "lease": lambda client: client.lease("anna").acquire(),
    "state": Client.state,
    "events": Client.events,
    "plan": Client.plan,
    "mesh": Client.mesh,
}


@pytest.mark.parametrize("how", ["reply", "reply_err"])
@pytest.mark.parametrize("ask", sorted(ASKS))
def test_what_is_no_answer_is_said(false_daemon, client, ask, how):
    wrong = 0
    for payload in PAYLOADS:
        false_daemon.replies = (
            (lambda query, p=payload: query.reply(query.key_expr, p))
            if how == "reply"
            else (lambda query, p=payload: query.reply_err(p))
        )
        caught = None
        try:
            ASKS[ask](client)
        except ClientError as error:
            caught = error
        if caught is not None:
            assert (caught.code, "not what the daemon says" in str(caught)) == ("bad_answer", True)
            wrong += 1
    assert wrong >= len(PAYLOADS) - (1 if how == "reply" else 0)  # [] are no events; null, no plan


def test_two_answers_are_one_too_many(false_daemon, client):
    def twice(query):
        for _ in range(2):
            query.reply(query.key_expr, b'{"state": "OFF"}')

    false_daemon.replies = twice
    with pytest.raises(
        ClientError, match=r"2 answers to motord/false/rpc/stop, from .*zid"
    ) as caught:
        client.rpc("stop")
    assert caught.value.code == "bad_answer"


def test_an_answer_on_another_key_is_none(false_daemon, client):
    false_daemon.replies = lambda query: query.reply(f"{ROOT}/rpc/enable", b'{"state": "OFF"}')
    with pytest.raises(ClientError):  # Zenoh itself takes none that was not asked for
        client.rpc("stop")


def test_no_answer_of_somebody_who_is_there_is_said(false_daemon, client):
    false_daemon.replies = lambda query: None
    with pytest.raises(ClientError, match="no answer to rpc/stop") as caught:
        client.rpc("stop")
    assert caught.value.code == "busy"


def test_an_rpc_that_is_asked_for_without_its_prefix_is_named_with_it(false_daemon, client):
    with pytest.raises(ClientError, match="this RPC is asked as rpc/lease/acquire") as caught:
        client.ask("lease/acquire")
    assert caught.value.code == "unknown"


def test_what_is_too_long_is_not_sent(client):
    for name in sorted(set(RPCS) - {"calibration/install"}):
        with pytest.raises(ClientError, match="more than the 65536 allowed") as caught:
            client.rpc(name, by="x" * MAX_REQUEST_BYTES)
        assert caught.value.code == "invalid"


def test_what_is_too_long_is_not_read():
    with pytest.raises(ClientError, match="at most"):
        decode_state(bytes(MAX_REPLY_BYTES + 1))


SETPOINT = {
    "torque_Nm": 1.0, "torque_target_Nm": 2.0, "speed_Hz": None, "brake": 0.0, "drive_Hz": 0.0,
    "compensate": "on",
}  # fmt: skip


def answer_to_set(**changes):
    content = {"state": "ENABLED", "reached_in_s": 1.0, "setpoint": {**SETPOINT, **changes}}
    return decode_reply(RPCS["set"], json.dumps(content).encode())


def test_what_the_set_point_of_a_reply_has_besides_is_passed_on():
    assert answer_to_set(speed_set_by="anna").content()["setpoint"]["speed_set_by"] == "anna"


@pytest.mark.parametrize(
    ("key", "value"), [("torque_Nm", "1.0"), ("brake", True), ("drive_Hz", math.nan)]
)
def test_a_set_point_of_a_reply_that_is_not_of_its_types_is_none(key, value):
    with pytest.raises(ClientError, match=f"not what the daemon says: .*{key}"):
        answer_to_set(**{key: value})


DECODERS = {
    **{name: lambda content, rpc=RPCS[name]: decode_reply(rpc, content) for name in sorted(RPCS)},
    "state": decode_state,
    "event": decode_event,
    "events": decode_events,
    "plan": decode_plan,
    "plan or none": decode_plan_or_none,
    "mesh": decode_mesh,
    "mesh or none": decode_mesh_or_none,
    "ticks": decode_ticks,
}
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(["token", "state", "t_ns", "points", "kind"]), inner)
    ),
    max_leaves=10,
)


@settings(max_examples=200)
@given(content=st.binary(max_size=80) | json_values.map(lambda value: json.dumps(value).encode()))
def test_nothing_but_the_clients_own_error_escapes(content):
    for decode in DECODERS.values():
        with suppress(ClientError):
            decode(content)


def test_a_subscription_drops_what_is_malformed_and_goes_on(false_daemon, client, caplog):
    good, arrived = decode_event(b'{"t_ns": 1, "kind": "k", "message": "m", "data": {}}'), []
    done = threading.Event()

    def take(event):
        arrived.append(event)
        done.set()

    with caplog.at_level(logging.WARNING, "motord"), client.subscribe_events(take) as events:
        client_is_there = false_daemon.session.declare_publisher(
            f"{ROOT}/event", congestion_control=zenoh.CongestionControl.BLOCK
        )
        while not client_is_there.matching_status.matching:
            time.sleep(0.01)
        for payload in PAYLOADS:
            client_is_there.put(payload)
        client_is_there.delete()
        client_is_there.put(good.to_json())
        assert done.wait(PATIENCE_S)
        assert arrived == [good]
        assert events.malformed == len(PAYLOADS) + 1
    assert caplog.text.count("not what the daemon says") == 1
