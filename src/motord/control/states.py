"""The drive's states: OFF -> READY -> ENABLED -> (TRIPPED -> reset -> READY), as a pure table.

`transition` is compiled; tests walk it over every state, request and condition.
"""

from motord.jit import constants, jit
from motord.schema import Request, State

STATE, _REQUEST = constants(State), constants(Request)


@jit
def transition(
    state: int,
    arming: bool,
    stopping: bool,
    request: int,
    causes: int,
    inverter_ready: bool,
    at_zero: bool,
) -> tuple[int, bool, bool]:
    """Return (state, arming, stopping) after one tick.

    `causes` are the trip conditions that hold now, `at_zero` that the torque set-point has
    ramped to zero. OFF and TRIPPED never leave by themselves.
    """
    if state == STATE.TRIPPED:
        if request == _REQUEST.RESET and causes == 0:
            return STATE.READY, False, False
        return STATE.TRIPPED, False, False
    if state == STATE.OFF:
        if request == _REQUEST.ENABLE and causes == 0:
            return STATE.READY, True, False
        return STATE.OFF, False, False
    if causes != 0:
        return STATE.TRIPPED, False, False
    if request == _REQUEST.STOP:
        return STATE.OFF, False, False
    if state == STATE.READY:
        arming = (arming or request == _REQUEST.ENABLE) and request != _REQUEST.DISABLE
        if arming and inverter_ready:
            return STATE.ENABLED, False, False
        return STATE.READY, arming, False
    stopping = (stopping or request == _REQUEST.DISABLE) and request != _REQUEST.ENABLE
    if stopping and at_zero:
        return STATE.READY, False, False
    return STATE.ENABLED, False, stopping
