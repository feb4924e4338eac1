"""In command: never two at a time, and nobody's silence keeps the torque up."""

from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.schema import State
from motord.service.refusal import Refusal
from tests.unit.service.virtual_service import STEP_NS, VirtualService

LOOK_S = 0.05
"""A few steps of the supervisor: expiry seen, ramp begun, tick read."""


@pytest.mark.parametrize("torque_Nm", [0.5, 3.0])
@pytest.mark.parametrize("lease_s", [0.2, 1.0])
def test_a_silent_commander_leaves_no_torque_behind(torque_Nm, lease_s):
    service = VirtualService(zenoh={"lease_s": lease_s})
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=torque_Nm, speed_Hz=0.5)
    service.run_s(2.0, token)
    assert service.bench.watch.torque_set_Nm == pytest.approx(torque_Nm)
    service.bench.lease.renew(token, service.now_ns)  # and then nothing more
    begun_ns = service.now_ns
    while service.bench.watch.torque_set_Nm != 0.0 or service.bench.state is State.ENABLED:
        service.step()
        assert service.now_ns < begun_ns + 10**10
    took_s = (service.now_ns - begun_ns) / 1e9
    ramp_s = torque_Nm / service.config.limits.torque_rate_Nm_per_s
    assert lease_s <= took_s <= lease_s + ramp_s + LOOK_S
    assert "lease" in service.kinds()


WHO = st.sampled_from(["anna", "ben"])
MOVES = st.lists(
    st.tuples(WHO, st.sampled_from(["acquire", "force", "release", "set", "sleep"])), max_size=20
)


@settings(deadline=None, max_examples=30)
@given(MOVES)
def test_of_two_commanders_one_at_most_can_set(moves):
    service = VirtualService(zenoh={"lease_s": 0.2})
    tokens = {"anna": "none", "ben": "none"}
    for who, move in moves:
        _make(service, who, move, tokens)
        assert sum(_may_set(service, token) for token in tokens.values()) <= 1


def _make(service, who, move, tokens):
    if move in ("acquire", "force"):
        with suppress(Refusal):
            tokens[who] = service.acquire(who, force=move == "force")
    elif move == "sleep":
        service.step(round(0.15e9 / STEP_NS))
    elif move == "release":
        _taken(service, "lease/release", token=tokens[who])
    else:
        _taken(service, "set", token=tokens[who], speed_Hz=0.1)


def _taken(service, name, **arguments):
    outcome = service.begin(name, **arguments).outcome
    assert not isinstance(outcome, Refusal) or outcome.code == "no_lease"
    return not isinstance(outcome, Refusal)


def _may_set(service, token):
    return _taken(service, "set", token=token, torque_Nm=0.0)


def test_a_takeover_is_explicit_and_logged():
    service = VirtualService()
    service.acquire("anna")
    with pytest.raises(Refusal, match="take over with force"):
        service.acquire("ben")
    service.acquire("ben", force=True)
    taken = next(e for e in reversed(service.events.recent()) if e.kind == "lease")
    assert taken.message == "ben is in command, taking over from anna"
    assert taken.data == {"holder": "ben", "took_over_from": "anna"}
