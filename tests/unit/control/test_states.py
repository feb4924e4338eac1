"""The transition table, over every state, request and condition."""

import itertools

import numpy as np
import pytest

from motord.control.states import transition
from motord.schema import Request, State

CASES = list(
    itertools.product(
        State, (False, True), (False, True), Request, (0, 1, 1 << 20), (False, True), (False, True)
    )
)


@pytest.mark.kernel
def test_every_case_obeys_the_rules() -> None:
    for state, arming, stopping, request, causes, ready, at_zero in CASES:
        after, armed, stops = transition(
            int(state), arming, stopping, int(request), causes, ready, at_zero
        )
        case = (state, arming, stopping, request, causes, ready, at_zero, State(after))
        if after == State.ENABLED and state != State.ENABLED:
            assert state == State.READY, case
            assert arming or request == Request.ENABLE, case
            assert ready, case
            assert causes == 0, case
        if causes and state in (State.READY, State.ENABLED):
            assert after == State.TRIPPED, case
        if state == State.TRIPPED:
            left = request == Request.RESET and causes == 0
            assert after == (State.READY if left else State.TRIPPED), case
        if state == State.OFF:
            asked = request == Request.ENABLE and causes == 0
            assert after == (State.READY if asked else State.OFF), case
        if request == Request.STOP and state in (State.READY, State.ENABLED):
            assert after in (State.OFF, State.TRIPPED), case
        if armed:
            assert after == State.READY, case
        if stops:
            assert after == State.ENABLED, case


def without_causes(state, arming, stopping, request, ready, at_zero):
    """What comes next, specified request by request."""
    asked = {
        State.OFF: {Request.ENABLE: (State.READY, True, False)},
        State.READY: {
            Request.ENABLE: (State.ENABLED, False, False) if ready else (State.READY, True, False),
            Request.DISABLE: (State.READY, False, False),
            Request.STOP: (State.OFF, False, False),
        },
        State.ENABLED: {
            Request.ENABLE: (State.ENABLED, False, False),
            Request.DISABLE: (State.READY, False, False)
            if at_zero
            else (State.ENABLED, False, True),
            Request.STOP: (State.OFF, False, False),
        },
        State.TRIPPED: {Request.RESET: (State.READY, False, False)},
    }
    if state is State.READY and arming and request not in (Request.DISABLE, Request.STOP):
        request = Request.ENABLE
    if state is State.ENABLED and stopping and request not in (Request.ENABLE, Request.STOP):
        request = Request.DISABLE
    return asked[state].get(request, (state, False, False))


@pytest.mark.kernel
def test_every_case_ends_as_specified() -> None:
    for state, arming, stopping, request, causes, ready, at_zero in CASES:
        expected = without_causes(state, arming, stopping, request, ready, at_zero)
        if causes:
            tripped = state in (State.READY, State.ENABLED, State.TRIPPED)
            expected = (State.TRIPPED if tripped else State.OFF, False, False)
        found = transition(int(state), arming, stopping, int(request), causes, ready, at_zero)
        case = (state, arming, stopping, request, causes, ready, at_zero)
        assert tuple(found) == expected, case
        assert all(isinstance(flag, (bool, np.bool_)) for flag in found[1:]), case


@pytest.mark.parametrize("state", list(State))
def test_nothing_moves_by_itself(state: State) -> None:
    after, armed, stops = transition(int(state), False, False, int(Request.NONE), 0, True, True)
    assert (after, armed, stops) == (state, False, False)


def test_disable_waits_for_zero_torque() -> None:
    enabled, disable, none = int(State.ENABLED), int(Request.DISABLE), int(Request.NONE)
    assert transition(enabled, False, False, disable, 0, True, False) == (enabled, False, True)
    assert transition(enabled, False, True, none, 0, True, False) == (enabled, False, True)
    assert transition(enabled, False, True, none, 0, True, True) == (State.READY, False, False)


def test_enable_recalls_a_ramp_down() -> None:
    enabled, enable = int(State.ENABLED), int(Request.ENABLE)
    assert transition(enabled, False, True, enable, 0, True, True) == (enabled, False, False)
