"""In command: never two at a time, and nobody's silence keeps the torque up."""

from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.api.errors import RpcError
from motord.config.faults import Fault
from motord.schema import State
from tests.unit.service.virtual_service import STEP_NS, VirtualService

QUICK = {"lease_s": 0.5}, {"torque_rate_Nm_per_s": 100.0}, {"supervisor_timeout_s": 0.1}
"""A short lease, and limits that it is long enough for."""


def quick_service():
    zenoh, limits, loop = QUICK
    return VirtualService(zenoh=zenoh, limits=limits, loop=loop)


def silence_s(service, token):
    """Let the commander fall silent; return how long torque lasts after the last renewal."""
    service.bench.lease.renew(token, service.now_ns)
    begun_ns = last_ns = service.now_ns
    while service.bench.state is State.ENABLED:
        if service.bench.monitor.torque_set_Nm != 0.0:
            last_ns = service.now_ns
        service.step()
        assert service.now_ns < begun_ns + 10**10
    return (last_ns - begun_ns) / 1e9


@pytest.mark.parametrize("torque_Nm", [0.5, 3.0, 5.5])
@pytest.mark.parametrize("lease_s", [1.3, 2.0])
def test_a_silent_commander_leaves_no_torque_behind(torque_Nm, lease_s):
    service = VirtualService(zenoh={"lease_s": lease_s})
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=torque_Nm, brake=1.0)
    service.run_s(2.0, token)
    assert service.bench.monitor.torque_set_Nm == pytest.approx(torque_Nm)
    timeout_s = service.config.loop.supervisor_timeout_s
    assert lease_s - timeout_s - 0.1 <= silence_s(service, token) <= lease_s
    assert "lease" in service.kinds()


@settings(deadline=None, max_examples=30)
@given(st.floats(0.0, 6.0), st.integers(0, 60), st.booleans())
def test_no_torque_that_rises_outlasts_the_lease(torque_Nm, steps, hangs):
    """Torque set at any moment before the silence; a supervisor that hangs then, too."""
    service = VirtualService(zenoh={"lease_s": 1.5})
    token = service.enabled()
    service.bench.lease.renew(token, service.now_ns)
    begun_ns = service.now_ns
    service.step(steps)
    service.ask("set", token=token, torque_Nm=torque_Nm, brake=1.0)
    while service.bench.lease.holder(service.now_ns):
        if hangs and service.bench.lease.remaining_s(service.now_ns) < 0.015:
            break
        service.step()
    if hangs:
        service.loop.virtual.inject(Fault(kind="supervisor_silent", for_s=5.0))
    while service.loop.last_torque_set_Nm != 0.0:
        if hangs:  # the loop alone goes on
            service.now_ns += STEP_NS
            service.loop.run()
        else:
            service.step()
        assert service.now_ns <= begun_ns + 1_500_000_000


def test_a_plan_of_a_silent_commander_is_at_zero_when_the_lease_ends():
    service = VirtualService()
    token = service.acquire()
    point = {"torques_Nm": [3.0], "speeds_Hz": [0.7], "turns": 1000}
    service.ask("plan/start", token=token, name="calibrate", settings=point)
    service.run_s(4.0, token)
    assert service.bench.monitor.torque_set_Nm == pytest.approx(3.0)
    assert silence_s(service, token) <= service.config.zenoh.lease_s
    service.step(5)
    assert service.bench.plans.view.state == "aborted"


def test_a_lease_says_how_soon_it_must_be_renewed():
    service = VirtualService()
    answer = service.ask("lease/acquire", holder="anna")
    assert answer["lease_s"] == 2.0
    assert 1.0 < answer["renew_within_s"] < 2.0 - 0.6 - 0.25
    token = answer["token"]
    service.ask("enable", token=token)
    service.ask("set", token=token, torque_Nm=6.0, brake=1.0)
    service.run_s(1.5, token)
    again = service.ask("lease/renew", token=token)
    assert again == {"lease_s": 2.0, "renew_within_s": answer["renew_within_s"]}
    service.run_s(answer["renew_within_s"] - 0.02)
    service.ask("lease/renew", token=token)
    service.run_s(answer["renew_within_s"] + 0.02)
    with pytest.raises(RpcError, match="ran out"):
        service.ask("lease/renew", token=token)


WHO = st.sampled_from(["anna", "ben"])
MOVES = st.lists(
    st.tuples(WHO, st.sampled_from(["acquire", "force", "release", "set", "sleep"])), max_size=20
)


@settings(deadline=None, max_examples=30)
@given(MOVES)
def test_of_two_commanders_one_at_most_can_set(moves):
    service = quick_service()
    tokens = {"anna": "none", "ben": "none"}
    for who, move in moves:
        _make(service, who, move, tokens)
        assert sum(_may_set(service, token) for token in tokens.values()) <= 1
    _make(service, "ben", "force", tokens)
    assert [_may_set(service, token) for token in tokens.values()] == [False, True]


def _make(service, who, move, tokens):
    if move in ("acquire", "force"):
        with suppress(RpcError):
            tokens[who] = service.acquire(who, force=move == "force")
    elif move == "sleep":
        service.step(round(0.25e9 / STEP_NS))
    elif move == "release":
        _taken(service, "lease/release", token=tokens[who])
    else:
        _taken(service, "set", token=tokens[who], speed_Hz=0.1)


def _taken(service, name, **arguments):
    outcome = service.begin(name, **arguments).outcome
    assert not isinstance(outcome, RpcError) or outcome.code == "no_lease"
    return not isinstance(outcome, RpcError)


def _may_set(service, token):
    return _taken(service, "set", token=token, torque_Nm=0.0)


def test_a_takeover_is_explicit_and_logged():
    service = VirtualService()
    service.acquire("anna")
    with pytest.raises(RpcError, match="take over with force"):
        service.acquire("ben")
    service.acquire("ben", force=True)
    taken = next(e for e in reversed(service.events.recent()) if e.kind == "lease")
    assert taken.message == "ben is in command, taking over from anna"
    assert taken.data == {"holder": "ben", "took_over_from": "anna"}
