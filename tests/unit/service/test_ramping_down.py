"""Requests that come while the torque ramps to zero are carried out once it is there."""

import pytest

from motord.api.errors import RpcError
from motord.schema import Request, State
from tests.unit.service.virtual_service import VirtualService

TORQUE_Nm = 2.0
NEXT = {
    "enable": {},
    "set": {"enable": True, "torque_Nm": 1.0, "speed_Hz": 0.5},
    "plan/start": {"name": "cogging"},
    "queue/start": {},
}


@pytest.fixture
def service():
    return VirtualService()


def under_torque(service, **queued):
    """Return the token of who has set a torque, of a bench with a queue of plans."""
    token = service.enabled()
    service.ask("queue/add", token=token, plans=[{"name": "cogging"}])
    service.ask("set", token=token, torque_Nm=TORQUE_Nm, speed_Hz=0.6)
    service.run_s(2.0, token)
    assert service.bench.monitor.torque_set_Nm == TORQUE_Nm
    return token


def next_in_command(service, token, how):
    """Let the bench ramp down; return the token of who is in command then."""
    if how == "disable":
        service.begin("disable", token=token)
        return token
    if how == "takeover":
        grant = service.ask("lease/acquire", holder="ben", force=True)
        service.begin("disable", token=grant["token"])
        return grant["token"]
    service.ask("lease/release", token=token)
    return service.acquire()


@pytest.mark.parametrize("how", ["release", "disable", "takeover"])
@pytest.mark.parametrize("name", NEXT)
def test_who_commands_next_need_not_wait_for_the_ramp(service, name, how):
    token = next_in_command(service, under_torque(service), how)
    pending = service.begin(name, token=token, **NEXT[name])
    service.step(5)
    assert pending.outcome is None
    assert service.bench.state is State.ENABLED
    assert 0.0 < service.bench.monitor.torque_set_Nm < TORQUE_Nm
    states = []
    while State.READY not in states:
        service.step()
        states.append(service.bench.state)
    assert states.index(State.READY) > 5  # no sooner than the torque has fallen
    service.run_s(0.5, token)
    assert not isinstance(pending.outcome, RpcError)
    assert pending.outcome is not None
    assert service.bench.plans.active or service.bench.state is State.ENABLED


@pytest.mark.parametrize("last", ["disable", "plan/abort"])
@pytest.mark.parametrize("name", NEXT)
def test_what_was_to_come_after_the_ramp_does_not_if_it_is_disabled_again(service, name, last):
    token = next_in_command(service, under_torque(service), "disable")
    pending = service.begin(name, token=token, **NEXT[name])
    service.step(5)
    assert pending.outcome is None
    service.begin("disable", token="of nobody")
    service.step()
    assert pending.outcome is None
    service.begin(last, token=token)
    service.run_s(3.0, token)
    assert service.bench.state is State.READY
    assert not service.bench.plans.active
    assert f"{last} came after it" in str(pending.outcome)


def test_a_plan_begins_once_a_torque_that_was_set_to_zero_is_zero(service):
    token = under_torque(service)
    service.ask("set", token=token, torque_Nm=0.0)
    assert service.ask("plan/start", token=token, name="cogging")["points"]
    assert service.bench.monitor.torque_set_Nm == 0.0
    assert service.bench.plans.active


def test_a_torque_alone_is_refused_once_it_is_disabled(service):
    token = next_in_command(service, under_torque(service), "release")
    with pytest.raises(RpcError, match="enable"):
        service.ask("set", token=token, torque_Nm=1.0)
    assert service.bench.state is State.READY


def test_a_stop_refuses_what_waits_for_the_ramp(service):
    token = next_in_command(service, under_torque(service), "release")
    pending = service.begin("plan/start", token=token, name="cogging")
    assert service.ask("stop") == {"state": "OFF"}
    assert "it was stopped" in pending.outcome.message
    service.run_s(1.0, token)
    assert service.bench.state is State.OFF
    assert not service.bench.plans.active


def test_who_loses_the_lease_meanwhile_is_refused(service):
    token = next_in_command(service, under_torque(service), "release")
    pending = service.begin("set", token=token, enable=True, torque_Nm=1.0, speed_Hz=0.5)
    service.ask("lease/acquire", holder="eve", force=True)
    service.run_s(1.0)
    assert pending.outcome.code == "no_lease"
    assert service.bench.state is not State.ENABLED


def test_a_torque_that_does_not_ramp_to_zero_is_the_answer(service):
    token = under_torque(service)
    service.bench.setpoint.newest_request = Request.DISABLE  # which the loop does not carry out
    pending = service.begin("enable", token=token)
    limits_Nm = service.config.limits.torque_Nm
    service.run_s(service.config.wind_down_s(limits_Nm) - 0.05, token)
    assert pending.outcome is None
    service.run_s(0.1, token)
    assert pending.outcome.code == "refused"
    assert "still ramps to zero" in pending.outcome.message
