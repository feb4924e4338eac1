"""Ages of what the loop works with, and errors of its links, from the ticks of the last second.

Pure. The ticks count the errors of both links together; which link lacks frames shows in the ticks
without a new sample of it.
"""

from collections.abc import Callable

import numpy as np

from motord.api.messages import LinksView
from motord.schema import BridgeStatus, Flag, InverterStatus

LastSecond = Callable[[str], np.ndarray]
"""Returns a field of the ticks of the last second, shape (n,), n > 0."""


def ages_s(last_second: LastSecond, rate_Hz: float, tick_age_s: float) -> dict[str, float]:
    """Return the age (s) of each signal now, `tick_age_s` after the newest tick was read.

    What was not good in any tick of the last second is at least so old.
    """
    bridge = last_second("bridge_status")
    sample_age_s = 1e-9 * last_second("sample_age_ns")
    current_age_s = sample_age_s + 1e-9 * last_second("i_age_ns")
    seq = last_second("setpoint_seq")
    back_s = np.arange(len(seq))[::-1] / rate_Hz  # of each tick, before the newest

    def newest(good: np.ndarray, ages: np.ndarray) -> float:
        """Return the age of the newest good one, of the oldest if there is none."""
        at = -1 - int(np.argmax(good[::-1])) if good.any() else 0
        return float(ages[at] + back_s[at]) + tick_age_s

    first_of_newest = np.diff(seq, prepend=seq[0]) != 0
    always = np.ones(1, bool)
    found = {
        "tick": tick_age_s,
        "encoder": newest(bridge & BridgeStatus.ENCODER_INVALID == 0, sample_age_s),
        "torque": newest(bridge & BridgeStatus.TORQUE_INVALID == 0, sample_age_s),
        "inverter": newest(always, current_age_s),
        "heartbeat": newest(first_of_newest, np.zeros(len(seq))),
    }
    return {name: round(age_s, 6) for name, age_s in found.items()}


def links(last_second: LastSecond) -> LinksView:
    """Return the errors of both links, and ticks without a new sample or feedback."""
    errors, flags = last_second("link_errors"), last_second("flags")
    status = int(last_second("inverter_status")[-1])
    return LinksView(
        errors=int(errors[-1]),
        errors_last_s=int(errors[-1]) - int(errors[0]),
        ticks_last_s=len(flags),
        without_encoder_last_s=int((flags & Flag.NEW_ENCODER == 0).sum()),
        without_inverter_last_s=int((flags & Flag.NEW_INVERTER == 0).sum()),
        bus_off=bool(status & InverterStatus.BUS_OFF),
    )
