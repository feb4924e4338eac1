"""The drive's states: OFF -> READY -> ENABLED -> (TRIPPED -> reset -> READY), as a pure table.

`transition` is compiled; tests walk it over every state, request and condition.
"""

from motord.jit import jit
from motord.schema import Request, State

__all__ = ["Request", "State", "transition"]

OFF, READY, ENABLED, TRIPPED = (int(s) for s in State)


_ENABLE, _DISABLE, _STOP, _RESET = (int(r) for r in list(Request)[1:])


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
    if state == TRIPPED:
        if request == _RESET and causes == 0:
            return READY, False, False
        return TRIPPED, False, False
    if state == OFF:
        if request == _ENABLE and causes == 0:
            return READY, True, False
        return OFF, False, False
    if causes != 0:
        return TRIPPED, False, False
    if request == _STOP:
        return OFF, False, False
    if state == READY:
        arming = (arming or request == _ENABLE) and request != _DISABLE
        if arming and inverter_ready:
            return ENABLED, False, False
        return READY, arming, False
    stopping = (stopping or request == _DISABLE) and request != _ENABLE
    if stopping and at_zero:
        return READY, False, False
    return ENABLED, False, stopping
