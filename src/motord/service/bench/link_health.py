"""Ages of what the loop works with, and errors of its links, from the ticks of the last second.

Pure. The ticks count the errors of both links together; which link lacks frames shows in the ticks
without a new sample of it.
"""

from collections.abc import Callable

import numpy as np

from motord.api.descriptions import bridge_action
from motord.api.messages import LinksView
from motord.schema import BridgeStatus, Flag, InverterStatus

LastSecond = Callable[[str], np.ndarray]
"""Returns a field of the ticks of the last second, shape (n,), n > 0."""


def ages_s(last_second: LastSecond, rate_Hz: float, tick_age_s: float) -> dict[str, float]:
    """Return the age (s) of each signal now, `tick_age_s` after the newest tick was read.

    What was not good in any tick of the last second is at least so old.
    """
    bridge, seq = last_second("bridge_status"), last_second("setpoint_seq")
    sample_age_ns = last_second("sample_age_ns")

    def sampled_s(good: np.ndarray) -> float:
        """Return the age of the newest good sample, of the oldest if there is none."""
        back = _newest(good)
        return tick_age_s + back / rate_Hz + 1e-9 * int(sample_age_ns[-1 - back])

    current_age_ns = int(sample_age_ns[-1]) + int(last_second("i_age_ns")[-1])
    found = {
        "tick": tick_age_s,
        "encoder": sampled_s(bridge & int(BridgeStatus.ENCODER_INVALID) == 0),
        "torque": sampled_s(bridge & int(BridgeStatus.TORQUE_INVALID) == 0),
        "inverter": tick_age_s + 1e-9 * current_age_ns,
        "heartbeat": tick_age_s + _newest(seq[1:] != seq[:-1]) / rate_Hz,
    }
    return {name: round(age_s, 6) for name, age_s in found.items()}


def _newest(good: np.ndarray) -> int:
    """Return how many ticks ago the newest good one is; the oldest of all if there is none."""
    if not good.any():
        return max(len(good) - 1, 0)
    return int(np.argmax(good[::-1]))


def links(last_second: LastSecond) -> LinksView:
    """Return the errors of both links, and ticks without a new sample or feedback."""
    errors, flags = last_second("link_errors"), last_second("flags")
    status = int(last_second("inverter_status")[-1])
    return LinksView(
        errors=int(errors[-1]),
        errors_last_s=int(errors[-1]) - int(errors[0]),
        ticks_last_s=len(flags),
        without_encoder_last_s=int(np.count_nonzero(flags & int(Flag.NEW_ENCODER) == 0)),
        without_inverter_last_s=int(np.count_nonzero(flags & int(Flag.NEW_INVERTER) == 0)),
        bus_off=bool(status & InverterStatus.BUS_OFF),
        bridge=bridge_action(int(np.bitwise_or.reduce(last_second("bridge_status")))),
    )
