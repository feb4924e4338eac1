"""Ripple as it is on the shaft: images of held currents where they are, not where they alias to."""

import numpy as np

from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification.aliased_ripple import (
    ZeroOrderHold,
    image_torques,
    with_images,
    without_aliases,
)
from motord.identification.operating_points import Samples
from motord.identification.point_ripple import PointRipple, point_ripple

AS_COMMANDED = np.ones(3)
"""What flows over what is commanded, as far as images go: the measured ripple of a recording is the
same with a calibration and without."""


def shaft_ripple(
    samples: Samples, motor: MotorConfig, sensor: TorqueSensorConfig, hold: ZeroOrderHold | None
) -> PointRipple:
    """Return the ripple of these samples, see `with_held_images`."""
    return with_held_images(point_ripple(samples, motor, sensor), samples, motor, sensor, hold)


def with_held_images(
    seen: PointRipple,
    samples: Samples,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    hold: ZeroOrderHold | None,
) -> PointRipple:
    """Return the ripple seen with images of held currents where they are, not aliased.

    It is as the samples show it without timing of the currents, without their commands, and where
    samples are not a whole number of the loop's periods apart.
    """
    if hold is None or not samples.commanded or not hold.is_folded_by(samples):
        return seen
    images_Nm = image_torques(samples, AS_COMMANDED, motor, hold)
    freed = without_aliases(seen, samples, images_Nm, motor, sensor, hold)
    return with_images(freed, images_Nm, motor)
