"""Requests: what is right comes through, whatever else is refused as invalid, nothing escapes."""

import json
import math
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.api import requests
from motord.api.errors import MESSAGE_CHARACTERS, RpcError
from motord.api.messages import Event
from motord.api.replies import ErrorReply, LeaseTerms
from motord.api.requests import RPCS, parse
from motord.config.base import MAX_VALUES
from motord.config.experiments import plans_model

VALID = {
    "lease/acquire": {"holder": "anna@bench"},
    "lease/renew": {"token": "t"},
    "lease/release": {"token": "t"},
    "enable": {"token": "t"},
    "disable": {"token": "t"},
    "stop": {},
    "reset": {"token": "t"},
    "note": {"text": "Lager gewechselt \u2013 neu", "by": "anna"},
    "set": {"token": "t", "torque_Nm": 3, "speed_Hz": 0.7},
    "plan/start": {"name": "calibrate", "token": "t", "settings": {"turns": 2}},
    "plan/pause": {"token": "t"},
    "plan/resume": {"token": "t", "detach": True},
    "plan/abort": {"token": "t"},
    "plan/discard": {"token": "t"},
    "plan/list": {},
    "config": {},
    "calibration/list": {},
    "calibration/show": {"id": "0123abcd"},
    "calibration/install": {"token": "t", "calibration": {"id": "x"}},
    "queue/add": {"token": "t", "plans": [{"name": "cogging", "settings": {"turns": 2}}]},
    "queue/move": {"token": "t", "id": 3, "position": 1},
    "queue/remove": {"token": "t", "ids": [1, 2]},
    "queue/start": {"token": "t", "detach": True},
    "queue/pause": {"token": "t", "now": True},
    "queue/list": {},
    "calibration/adopt": {"token": "t", "accept": ["nothing-departed"]},
}

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4)
    ),
    max_leaves=12,
)
names = st.sampled_from(sorted(RPCS))


def refusal_of(name, payload):
    with pytest.raises(RpcError) as caught:
        parse(RPCS[name], payload)
    assert caught.value.code == "invalid"
    return caught.value.message


def test_there_is_a_valid_example_for_every_rpc():
    assert VALID.keys() == RPCS.keys()


@pytest.mark.parametrize("name", sorted(VALID))
def test_valid_requests_come_through(name):
    request = parse(RPCS[name], json.dumps(VALID[name]).encode())
    assert request.model_dump(exclude_unset=True) == VALID[name]


@pytest.mark.parametrize("name", sorted(VALID))
def test_an_unknown_field_is_named(name):
    assert "oops: unknown field" in refusal_of(
        name, json.dumps({**VALID[name], "oops": 1}).encode()
    )


@pytest.mark.parametrize("name", sorted(n for n in VALID if VALID[n]))
def test_missing_fields_are_named(name):
    required = [k for k, f in RPCS[name].request.model_fields.items() if f.is_required()]
    for field in required:
        body = {k: v for k, v in VALID[name].items() if k != field}
        assert f"{field}: missing" in refusal_of(name, json.dumps(body).encode())


def outcome(name, payload):
    try:
        return parse(RPCS[name], payload)
    except RpcError as refusal:
        return refusal.code


@given(name=names, payload=st.binary(max_size=64))
def test_bytes_never_escape(name, payload):
    assert outcome(name, payload) == "invalid" or payload in (b"", b"{}")


@given(name=names, body=json_values)
def test_json_never_escapes(name, body):
    request = outcome(name, json.dumps(body).encode())
    if request != "invalid":
        assert isinstance(body, dict)
        assert set(body) <= set(RPCS[name].request.model_fields)
        assert isinstance(request, RPCS[name].request)


@given(field=st.sampled_from(["torque_Nm", "speed_Hz", "brake", "drive_Hz"]), value=json_values)
def test_set_takes_finite_numbers_only(field, value):
    body = json.dumps({"token": "t", field: value}).encode()
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    finite = is_number and abs(value) <= sys.float_info.max
    in_range = finite and (field != "brake" or 0 <= value <= 1)
    if in_range:
        assert getattr(parse(RPCS["set"], body), field) == pytest.approx(value)
    elif value is None or (is_number and finite is False and isinstance(value, int)):
        return  # null is the same as left out; integers beyond a double are refused or infinite
    else:
        assert field in refusal_of("set", body)


@pytest.mark.parametrize(
    ("name", "body", "expected"),
    [
        ("set", {"token": "t"}, "nothing to set"),
        ("set", {"token": "t", "speed_Hz": 1, "brake": 0.5}, "give one of them"),
        ("set", {"token": "t", "torque_Nm": "3"}, "torque_Nm"),
        ("set", {"token": "t", "compensate": "some"}, "compensate"),
        ("lease/acquire", {"holder": ""}, "holder"),
        ("lease/acquire", {"holder": "a", "force": 1}, "force"),
        ("enable", {"token": ""}, "token"),
        ("note", {"text": ""}, "text"),
        ("note", {"text": "x" * 1001}, "text"),
        ("note", {"text": "a\nb"}, "printable"),
        ("note", {"text": "a\x1b[2J"}, "printable"),
        ("note", {"text": "  "}, "text"),
        ("note", {"text": "x", "by": "a\tb"}, "printable"),
        ("calibration/install", {"token": "t"}, "either calibration"),
        ("calibration/install", {"token": "t", "calibration": {}, "path": "/x"}, "either"),
    ],
)
def test_refusals_say_what_is_wrong(name, body, expected):
    assert expected in refusal_of(name, json.dumps(body).encode())


@pytest.mark.parametrize(
    "text", ['{"token": "t", "torque_Nm": NaN}', '{"token":"t","torque_Nm":1e999}']
)
def test_what_is_not_finite_is_refused(text):
    assert "torque_Nm" in refusal_of("set", text.encode())


def test_a_request_that_is_too_long_is_refused():
    body = json.dumps({"by": "x" * requests.MAX_REQUEST_BYTES}).encode()
    assert "bytes" in refusal_of("stop", body)


def test_no_payload_is_an_empty_object():
    assert parse(RPCS["stop"], b"").model_dump() == {"by": ""}


def test_replies_skip_what_they_do_not_know_and_lose_what_is_not_finite():
    text = Event(t_ns=1, kind="k", message="m", data={"x": float("nan")}).to_json()
    event = Event.model_validate({**json.loads(text), "new": 1})
    assert event.data == {"x": None}


def lists(schema, definitions, where=""):
    """Yield (where, most items) of every list that a JSON schema allows."""
    if "$ref" in schema:
        schema = definitions[schema["$ref"].rpartition("/")[2]]
    if schema.get("type") == "array":
        yield where, schema.get("maxItems", math.inf)
    inner = [("", s) for s in schema.get("anyOf", ())] + list(schema.get("properties", {}).items())
    for name, part in inner:
        yield from lists(part, definitions, f"{where}.{name}" if name else where)


def test_no_request_makes_a_plan_of_any_length():
    """A dry run needs no lease, and the supervisor builds the plan."""
    schema = plans_model().model_json_schema()
    found = dict(lists(schema, schema["$defs"]))
    assert ".calibrate.torques_Nm" in found
    assert [where for where, most in found.items() if most > MAX_VALUES] == []


def test_an_error_reply_is_never_longer_than_clients_take():
    reply = ErrorReply.model_validate_json(RpcError("invalid", "x" * 10_000).to_json())
    assert reply.message.endswith("xxx...")
    assert len(reply.message) == MESSAGE_CHARACTERS
    exact = RpcError("invalid", "y" * MESSAGE_CHARACTERS)
    assert ErrorReply.model_validate_json(exact.to_json()).message == exact.message


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_reply_is_json_also_where_an_error_let_a_number_through_that_is_none(value):
    reply = LeaseTerms.model_construct(lease_s=value, renew_within_s=1.5)
    sent = json.loads(reply.to_json(), parse_constant=pytest.fail)
    assert sent == {"lease_s": None, "renew_within_s": 1.5}
