"""What is wrong with the torque of a step: cut off, frozen."""

from math import pi

import numpy as np

from motord.identification.signal_condition import SignalFault, signal_faults

STILL_SHARE = 0.4
"""Of the samples at rest that are as the one before, above which levels hide the noise: half of
them or more are where it is small next to a level, 38 % where it is 0.7 of one."""


def torque_faults(
    torque_Nm: np.ndarray, begin: int, angle_rad: np.ndarray
) -> tuple[SignalFault, ...]:
    """Return the faults of a torque (n,) from sample `begin` on, nothing where none would show.

    A step is flat: of a converter whose levels hide the noise at rest it is one level, too.
    angle_rad (m,): since then.
    """
    if np.mean(np.diff(torque_Nm[:begin]) == 0) > STILL_SHARE:
        return ()
    turns = float(np.ptp(angle_rad)) / (2 * pi)
    return signal_faults({"torque_Nm": torque_Nm[begin:]}, turns, {})
