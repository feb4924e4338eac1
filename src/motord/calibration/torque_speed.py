"""Operating points by torque and speed, as the errors over a mesh are listed and shown."""

from collections.abc import Mapping
from typing import TypeVar

TorqueSpeed = tuple[float, float]
"""(torque_Nm, speed_Hz) of an operating point."""
Value = TypeVar("Value")


def by_magnitude(points: Mapping[TorqueSpeed, Value]) -> Mapping[TorqueSpeed, Value]:
    """Return values by the magnitudes of torque and speed, if that makes no two of them one.

    Of a mesh that is taken in both directions, every other point backwards, this is the whole mesh.
    """
    found = {(abs(torque), abs(speed)): value for (torque, speed), value in points.items()}
    return found if len(found) == len(points) else points
