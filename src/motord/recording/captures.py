"""The operating points of a recording, one at a time, the next being read meanwhile.

No more than these two are held in memory.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from motord.identification.operating_points import COMMANDS, REQUIRED, PointData, good_points, split
from motord.recording.reader import Run, bounds_of

COLUMNS = (*REQUIRED, *COMMANDS, "i_age_ns", "sample_age_ns", "tick", "plan_point")
"""Columns of the tick that identification reads."""


def captures(run: Run, columns: Sequence[str] = COLUMNS) -> Iterator[PointData]:
    """Yield the operating points of good quality with their ticks, in time order."""
    points = good_points(run.operating_points())
    with ThreadPoolExecutor(1, thread_name_prefix="captures") as reader:
        following = [reader.submit(_read, run, columns, point) for point in points[:1]]
        for number in range(len(points)):
            found = following.pop().result()
            ahead = points[number + 1 :][:1]
            following += [reader.submit(_read, run, columns, point) for point in ahead]
            yield found


def _read(run: Run, columns: Sequence[str], point: Mapping[str, Any]) -> PointData:
    """Return a point with its ticks, as many as the recording has of it."""
    return next(split(run.ticks(columns, **bounds_of(point)), [point], run.path.name))


@dataclass(frozen=True)
class TrueTorque:
    """True torque of an operating point of a simulated rig, over whole turns; n samples.

    angle_rad (n,): not wrapped; torque_Nm (n,); weights (n,): in proportion to the angle that
    each sample covers, as eq. (4.16) is over angle, not over time.
    """

    torque_set_Nm: float
    speed_Hz: float
    angle_rad: np.ndarray
    torque_Nm: np.ndarray
    weights: np.ndarray


TRUE_TORQUE = ("angle_rad", "speed_rad_s", "torque_Nm")


def true_torque(
    run: Run,
    columns: Sequence[str] = TRUE_TORQUE,
    refined: Callable[[np.ndarray], np.ndarray] = lambda truth: truth,
) -> Iterator[TrueTorque]:
    """Yield the true torque of each operating point of good quality, in time order.

    refined: returns TRUE_TORQUE, at more instants, of the truth that has these columns.
    """
    for point in good_points(run.operating_points()):
        truth = run.truth(columns, **bounds_of(point))
        yield true_torque_of(point, refined(truth))


def true_torque_of(point: Mapping[str, Any], truth: np.ndarray) -> TrueTorque:
    """Return the true torque of an operating point from the truth of its capture, in time order."""
    turned = np.abs(truth["angle_rad"] - truth["angle_rad"][0]) / (2 * np.pi)
    whole = turned < np.floor(turned[-1])
    return TrueTorque(
        torque_set_Nm=float(point["torque_Nm"]),
        speed_Hz=float(point["speed_Hz"]),
        angle_rad=truth["angle_rad"][whole],
        torque_Nm=truth["torque_Nm"][whole].astype(float),
        weights=np.abs(truth["speed_rad_s"][whole].astype(float)),
    )
