"""A plan that has ended commands nothing, however long the recorder takes to close its file."""

import pytest

from motord.api.errors import RpcError
from motord.schema import State
from tests.unit.service.test_driven import Driven
from tests.unit.service.virtual_service import VirtualService

STALL_S = 1.2
"""For so long the loop publishes nothing: a plan ends."""


def under_way(**changes):
    """Return a service with a plan in power, whose recording nobody closes, and the token."""
    service = VirtualService(**changes)
    token = service.acquire()
    service.ask("plan/start", token=token, name="calibrate")
    while service.bench.state is not State.ENABLED:
        service.run_s(0.1, token)
    service.sink.missing = None
    return service, token


def closing(end="stall", **changes):
    """Return a service whose plan was ended, with its recording being closed, and the token."""
    service, token = under_way(**changes)
    if end == "stall":
        service.loop.running = False
        service.run_s(STALL_S, token)
        service.loop.running = True
    else:
        service.ask("stop")
    service.step()
    assert service.bench.plans.closing
    return service, token


@pytest.mark.parametrize("found", ["", None])
def test_a_plan_that_ends_with_a_stalled_loop_disables_the_bench(found):
    service, token = under_way()
    service.sink.missing = found
    service.loop.running = False
    service.run_s(STALL_S, token)
    service.loop.running = True
    service.run_s(3.0, token)
    assert service.bench.state is State.READY
    assert service.bench.plans.closing is (found is None)


def test_an_operator_keeps_the_bench_over_a_stall():
    service = VirtualService()
    token = service.enabled()
    service.loop.running = False
    service.run_s(STALL_S, token)
    service.loop.running = True
    service.run_s(1.0, token)
    assert service.bench.state is State.ENABLED


def test_a_plan_that_ends_as_the_supervisor_was_suspended_disables_the_bench():
    service, token = under_way(devices={"drive": Driven().drive})
    service.bench.setpoint.drive_Hz = 1.0
    service.now_ns += 600_000_000
    service.step()
    assert service.bench.plans.closing
    service.run_s(3.0, token)
    assert service.bench.state is State.READY


def test_a_plan_fails_and_the_bench_is_off_when_the_computer_was_suspended():
    service, _ = under_way(devices={"drive": Driven().drive})
    service.sink.missing = ""
    service.bench.setpoint.drive_Hz = 1.0
    service.suspended_ns += 600_000_000
    service.step(2)
    assert service.bench.state is State.OFF
    assert service.bench.setpoint.drive_Hz == 0.0
    view = service.bench.plans.view
    assert (view.state, "the computer was suspended" in view.message) == ("failed", True)


def enabled_while_closing():
    """Return a bench that an operator has enabled while the recording closes, and the token."""
    service, token = closing("stop")
    service.ask("enable", token=token)
    service.ask("set", token=token, torque_Nm=0.5, speed_Hz=0.5)
    service.run_s(0.5, token)
    assert service.bench.plans.closing
    assert service.bench.state is State.ENABLED
    assert service.bench.setpoint_view().torque_target_Nm == 0.5
    return service, token


@pytest.mark.parametrize("how", ["disable", "lease/release", "expire", "stop", "fault"])
def test_torque_and_power_go_at_once_while_a_recording_closes(how):
    service, token = enabled_while_closing()
    if how == "fault":
        service.bench._drop_power("the brake is silent")
        assert service.bench.setpoint.torque_Nm == 0.0
        return
    if how == "stop":
        service.ask("stop")
    elif how == "expire":
        service.run_s(service.config.zenoh.lease_s)
    else:
        service.ask(how, token=token)
        service.run_s(2.0)
    assert service.bench.state is not State.ENABLED
    assert service.bench.plans.closing


def test_only_another_plan_waits_for_the_recording():
    service, token = closing("stop")
    assert service.ask("plan/abort", token=token)["state"] == "ending"
    with pytest.raises(RpcError, match="is ending; the remainder can be resumed"):
        service.ask("plan/resume", token=token)
    with pytest.raises(RpcError, match="its recording is still being closed") as refused:
        service.ask("plan/start", token=token, name="cogging")
    assert refused.value.code == "plan_running"
    assert "ramps down" not in refused.value.message
    token = service.acquire(force=True)
    with pytest.raises(RpcError, match="its recording is still being closed"):
        service.ask("plan/discard", token=token)
    token = service.acquire(force=True)
    waiting = service.begin("plan/start", token=token, name="cogging")
    service.step(3)
    assert waiting.outcome is None
    service.sink.missing = ""
    service.step(2)
    assert waiting.outcome["plan"] == "cogging"
    assert [view.state for view in service.sink.over] == ["aborted"]
