"""The ripple of operating points, freed of what sampling folds into it, and how far to learn.

A line that is not locked to the rotor, such as mains hum, leaves a part of it in the average over
the turns, nearly alike in even and odd ones. That counts as noise of each order: it is not learned.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification.aliased_ripple import ZeroOrderHold, image_torques, without_aliases
from motord.identification.disturbances.leakage import noise_of_lines
from motord.identification.disturbances.lines_of_points import DetectedLines, with_asynchronous
from motord.identification.operating_points import Samples
from motord.identification.point_ripple import PointRipple, point_ripple

BAND_SHARE = 0.25
"""Part of the loop's rate up to which a correction comes out as it should."""

LEAST_TURNS = 4
"""Whole turns below which noise cannot be separated from what repeats."""

NO_CURRENTS = np.empty((0, 3))
"""Of points of which angle and torque alone are kept."""


@dataclass(frozen=True, kw_only=True)
class SeenRipple(PointRipple):
    """Ripple of an operating point: orders 1 to n, and how far it is learned.

    noise_Nm has the part of lines that are not locked to the rotor. turns_Hz: speed as it was;
    band: highest order that the currents follow at that speed; highest: the highest to learn.
    """

    turns_Hz: float
    band: int
    highest: int


def band_order(samples: Samples, hold: ZeroOrderHold | None) -> int:
    """Return the highest order that the currents follow at this speed.

    A part of the loop's rate, or the corner of the current loops if that is lower. Without a bench
    file the loop is taken to be as fast as the samples.
    """
    band_Hz = BAND_SHARE / (samples.period_s if hold is None else hold.period_s)
    if hold is not None and hold.lag_s > 0:
        band_Hz = min(band_Hz, 1 / (2 * np.pi * hold.lag_s))
    return int(band_Hz / samples.speed_Hz)


def seen_points(
    points: Iterable[Samples],
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    gain: np.ndarray,
    hold: ZeroOrderHold | None,
    highest_order: int,
) -> list[SeenRipple]:
    """Return the ripple of each point, see `seen_by`, with what lines that others show leave."""
    found, turns = [], []
    for samples in points:
        seen = seen_by(samples, motor, sensor, gain, hold, highest_order)
        found.append((seen, DetectedLines.of(samples, motor.counts)))
        bare = replace(samples, i_A=NO_CURRENTS, command_A=NO_CURRENTS, sample_age_s=None)
        turns.append(bare)
    ripples = with_asynchronous(found, turns, motor, sensor)
    return [
        replace(one, noise_Nm=np.hypot(one.noise_Nm, noise_of_lines(one, samples, motor, sensor)))
        for one, samples in zip(ripples, turns, strict=True)
    ]


def seen_by(
    samples: Samples,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    gain: np.ndarray,
    hold: ZeroOrderHold | None,
    highest_order: int,
) -> SeenRipple:
    """Return the ripple of a point; gain (3,): what flows over what is commanded."""
    ripple = point_ripple(samples, motor, sensor)
    if hold is not None and hold.is_folded_by(samples):
        images_Nm = image_torques(samples, gain, motor, hold)
        ripple = without_aliases(ripple, samples, images_Nm, motor, sensor, hold)
    band = band_order(samples, hold)
    return SeenRipple(
        **vars(ripple), turns_Hz=samples.speed_Hz, band=band, highest=min(band, highest_order)
    )
