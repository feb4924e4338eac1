"""The operating points of a recording, one at a time: no more than one is held in memory."""

from collections.abc import Iterator

import numpy as np

from motord.identify.points import COMMANDS, REQUIRED, PointData, good_points, split
from motord.record.reader import Run

COLUMNS = (*REQUIRED, *COMMANDS, "i_age_ns", "tick", "plan_point")
"""Columns of the tick that identification reads."""


def captures(run: Run) -> Iterator[PointData]:
    """Yield the operating points of good quality with their ticks, in time order."""
    for point in good_points(run.operating_points()):
        ticks = run.ticks(COLUMNS, from_ns=int(point["t_start_ns"]), to_ns=int(point["t_end_ns"]))
        yield from split(ticks, [point])


def true_torque(run: Run) -> Iterator[tuple[float, float, np.ndarray, np.ndarray]]:
    """Yield (torque_Nm, speed_Hz, true torque (n,) in Nm, weights (n,)) of each operating point.

    Only a simulated rig records its truth. The samples are those of whole turns; the weights are
    the angle that each of them covers, as eq. (4.16) is over angle, not over time.
    """
    columns = ("angle_rad", "speed_rad_s", "torque_Nm")
    for point in good_points(run.operating_points()):
        truth = run.truth(columns, from_ns=int(point["t_start_ns"]), to_ns=int(point["t_end_ns"]))
        turned = (truth["angle_rad"] - truth["angle_rad"][0]) / (2 * np.pi)
        whole = turned < np.floor(turned[-1])
        yield (
            float(point["torque_Nm"]),
            float(point["speed_Hz"]),
            truth["torque_Nm"][whole].astype(float),
            np.abs(truth["speed_rad_s"][whole].astype(float)),
        )
