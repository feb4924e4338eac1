"""Torque of the currents against the one that is recorded: a note of the import, before any gain.

The same comparison as the finding `torque-of-currents` of a calibration (`slope_of`): what one
changes from point to point with the other, so that a zero does not count. But neither gains nor
what `[accuracy]` allows are known yet, and the torque may be a set-point: the limit is far wider.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from motord.identification.torque.torque_of_currents import SHOWN_PART, slope_of

TORQUE_RATIO = 2.0
"""Torque of the currents, in parts of the torque or its inverse, that no error of gain explains."""

ASKED = (
    "are order, sign and scale of the currents, zero and direction of the position, and back_emf "
    "(amplitude and phase_rad) right? A calibration from it would be wrong"
)


@dataclass(frozen=True)
class TorqueOfCurrents:
    """A point: torque that it is called by, and mean one of its currents by the back-EMF."""

    index: int
    torque_Nm: float
    made_Nm: float
    velocity_rad_s: float


def remarks(points: Sequence[TorqueOfCurrents], rated_Nm: float) -> Iterator[str]:
    """Yield a remark where the currents of the points do not make the torque, or exceed it.

    Where all are at one torque, of the first of which that is so.
    """
    torque_Nm = np.array([one.torque_Nm for one in points])
    made_Nm = np.array([one.made_Nm for one in points])
    if len(points) > 1 and np.ptp(torque_Nm) >= SHOWN_PART * rated_Nm:
        velocity_rad_s = np.array([one.velocity_rad_s for one in points])
        slope = slope_of(torque_Nm, made_Nm, velocity_rad_s)
        if slope.ratio < 1 / TORQUE_RATIO:
            torques = ["the torque", "that of the currents"]
            less, more = torques if slope.measured_smaller else torques[::-1]
            yield (
                f"by position, currents and back-EMF {less} changes from operating point to "
                f"operating point by {slope.ratio:.3g} times {more}: {ASKED}"
            )
        return
    for one in points:
        if not 1 / TORQUE_RATIO < one.made_Nm / one.torque_Nm < TORQUE_RATIO:
            yield (
                f"by position, currents and back-EMF operating point {one.index} makes "
                f"{one.made_Nm:.3g} Nm, its torque is {one.torque_Nm:.3g} Nm: {ASKED}"
            )
            return
