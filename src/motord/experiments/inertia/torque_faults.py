"""What is wrong with the torque of a step: cut off, frozen, ringing."""

from collections.abc import Iterator
from math import pi

import numpy as np

from motord.config import TorqueSensorConfig
from motord.findings import Finding
from motord.identification.signal_condition import SignalFault, signal_faults

STILL_SHARE = 0.4
"""Of the samples at rest that are as the one before, above which levels hide the noise: half of
them or more are where it is small next to a level, 38 % where it is 0.7 of one."""

MOUNT_GAIN = 3.0
"""Gain of the mount at the sampling rate from which on what currents held from tick to tick make
there shows as torque: 3.7 made the inertia 2 % too large, 2.0 half a percent."""


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


def mount_resonance(t_s: np.ndarray, sensor: TorqueSensorConfig) -> Iterator[Finding]:
    """Yield a finding where the mount resonates so near the sampling rate that all samples ring.

    t_s (n,): times of the samples.
    """
    if sensor.resonance_Hz == 0:
        return
    x = 1 / (float(np.median(np.diff(t_s))) * sensor.resonance_Hz)
    gain = 1 / max(abs(complex(1 - x**2, 2 * sensor.damping_ratio * x)), 1e-3)
    if gain > MOUNT_GAIN:
        yield Finding(
            "mount-resonance", gain, MOUNT_GAIN, "times", "serious",
            "the mount passes on so many times the torque at the loop's rate: what currents held "
            "from tick to tick make there shows in all samples as torque that does not act",
            "take another [loop] rate_Hz, farther from [torque_sensor] resonance_Hz",
        )  # fmt: skip
