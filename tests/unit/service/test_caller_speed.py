"""What a request is answered does not depend on how soon it comes after the one before.

But `plan/resume`: what is left of a plan is read before the request is carried out, once it ended;
and `plan/abort`: of a plan that still ends it is welcome, too.
"""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from motord.api.errors import RpcError
from motord.schema import State
from tests.unit.service.virtual_service import VirtualService

REQUESTS = {
    "enable": ("enable", {}),
    "torque": ("set", {"torque_Nm": 2.0, "speed_Hz": 0.6}),
    "torque of an enabled bench": ("set", {"enable": True, "torque_Nm": 2.0, "speed_Hz": 0.6}),
    "no torque": ("set", {"torque_Nm": 0.0}),
    "disable": ("disable", {}),
    "stop": ("stop", {}),
    "plan": ("plan/start", {"name": "calibrate"}),
    "pause": ("plan/pause", {}),
    "abort": ("plan/abort", {}),
    "discard": ("plan/discard", {}),
}
NEXT_HOLDER, TAKEOVER = "the next holder", "a takeover"
WAIT_S = 1.5
"""Time in which whatever a request began has come to its end, but for a plan."""


def answers(asked, wait_s):
    """Return the code of each answer, "" for one that is no refusal."""
    service, codes = VirtualService(), []
    token = service.acquire()
    for what in asked:
        name, arguments = REQUESTS.get(what, (what, {}))
        try:
            if what == NEXT_HOLDER:
                service.ask("lease/release", token=token)
                token = service.acquire()
            elif what == TAKEOVER:
                token = service.ask("lease/acquire", holder="ben", force=True)["token"]
            else:
                service.ask(name, **({} if name == "stop" else {"token": token}), **arguments)
            codes.append((what, ""))
        except RpcError as refusal:
            codes.append((what, "" if what == "abort" else refusal.code))
        service.run_s(wait_s, token)
    return codes


@pytest.mark.slow
@settings(max_examples=10)
@given(st.lists(st.sampled_from([*REQUESTS, NEXT_HOLDER, TAKEOVER]), max_size=8))
@example(["torque of an enabled bench", NEXT_HOLDER, "plan"])
@example(["torque of an enabled bench", NEXT_HOLDER, "torque"])
@example(["torque of an enabled bench", "no torque", "plan"])
@example(["torque of an enabled bench", "disable", "torque of an enabled bench"])
@example(["enable", "plan", "disable"])
@example(["plan", "abort", "pause", "abort", "discard", "enable"])
@example(["plan", NEXT_HOLDER, "discard", "plan", "pause", NEXT_HOLDER, "torque"])
def test_at_once_and_after_a_while_the_answer_is_the_same(asked):
    assert answers(asked, 0.0) == answers(asked, WAIT_S)


def test_a_plan_that_is_aborted_before_its_first_step_disables_an_enabled_bench():
    service = VirtualService()
    token = service.enabled()
    service.ask("plan/start", token=token, name="calibrate")
    service.ask("plan/abort", token=token)
    service.run_s(1.0, token)
    assert service.bench.state is State.READY
    assert service.bench.plans.view.state == "aborted"


@pytest.mark.parametrize("name", ["pause", "resume"])
def test_a_plan_that_ends_is_neither_paused_nor_resumed(name):
    service = VirtualService()
    token = service.acquire()
    service.ask("plan/start", token=token, name="calibrate")
    service.run_s(3.0, token)
    service.ask("plan/abort", token=token)
    assert service.bench.plans.view.state == "ending"
    with pytest.raises(RpcError, match="is ending"):
        service.ask(f"plan/{name}", token=token)
