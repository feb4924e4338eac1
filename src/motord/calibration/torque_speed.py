"""Operating points by torque and speed, as the errors over a mesh are listed and shown."""

from collections.abc import Iterable, Mapping
from typing import TypeVar

TorqueSpeed = tuple[float, float]
"""(torque_Nm, speed_Hz) of an operating point."""
Value = TypeVar("Value")


def by_magnitude(points: Mapping[TorqueSpeed, Value]) -> Mapping[TorqueSpeed, Value]:
    """Return values by the magnitudes of torque and speed, if these separate all of them."""
    if not magnitudes_differ(points):
        return points
    return {(abs(torque), abs(speed)): value for (torque, speed), value in points.items()}


def magnitudes_differ(points: Iterable[TorqueSpeed]) -> bool:
    """Return whether points that differ also differ in the magnitudes of torque or speed.

    A mesh that is taken in both directions, every other point backwards, is a whole mesh of these.
    """
    distinct = set(points)
    return len({(abs(torque), abs(speed)) for torque, speed in distinct}) == len(distinct)
