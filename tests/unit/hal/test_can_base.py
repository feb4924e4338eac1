"""What is counted of a bus, and when it is off."""

import pytest

from motord.hal.can.base import REFUSED_MAX, BusState

BUS_OFF, RESTARTED, CONTROLLER, ACKNOWLEDGE = 0x40, 0x100, 0x04, 0x20
RX_PASSIVE, TX_PASSIVE, TX_WARNING, ACTIVE = 0x10, 0x20, 0x08, 0x40


def test_off_by_error_frame_until_a_restart_or_a_frame() -> None:
    for restart in (lambda s: s.error_frame(RESTARTED, 0), BusState.received):
        state = BusState()
        state.error_frame(BUS_OFF, 0)
        assert state.off
        state.sent()  # taken into the queue of a controller that is off
        assert state.off
        restart(state)
        assert not state.off


def test_off_by_refused_sends_until_one_is_taken() -> None:
    state = BusState()
    for count in range(1, REFUSED_MAX + 3):
        state.refused("No buffer space available")
        assert state.off == (count >= REFUSED_MAX)
    assert (state.errors, state.last) == (REFUSED_MAX + 2, "No buffer space available")
    state.received()
    assert state.off
    state.sent()
    assert not state.off


@pytest.mark.parametrize("detail", [TX_WARNING, RX_PASSIVE, TX_PASSIVE])
def test_a_controller_that_is_active_again_is_no_error(detail: int) -> None:
    state = BusState()
    state.error_frame(CONTROLLER, detail)
    assert (state.off, state.error_frames) == (False, 1)
    state.error_frame(CONTROLLER, ACTIVE)
    assert state.error_frames == 1, "good news is no error"


def test_a_restart_ends_both_and_other_errors_count_only() -> None:
    state = BusState()
    state.error_frame(CONTROLLER | BUS_OFF, TX_PASSIVE)
    assert state.off
    state.error_frame(RESTARTED, 0)
    state.error_frame(ACKNOWLEDGE, 0)
    assert (state.off, state.errors) == (False, 3)
