"""The ripple of operating points, freed of what sampling folds into it, and how far to learn.

A line that is not locked to the rotor, such as mains hum, leaves a part of it in the average over
the turns, nearly alike in even and odd ones. That counts as noise of each order: it is not learned.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from motord.config import MotorConfig, TorqueSensorConfig
from motord.experiments.ilc.aliased_ripple import ZeroOrderHold, aliased_ripple
from motord.identification.disturbances.leakage import noise_of_lines
from motord.identification.disturbances.lines_of_points import DetectedLines, with_asynchronous
from motord.identification.operating_points import Samples
from motord.identification.point_ripple import PointRipple, point_ripple, repeating_rms

BAND_SHARE = 0.25
"""Part of the loop's rate up to which a correction comes out as it should."""

LEAST_TURNS = 4
"""Whole turns below which noise cannot be separated from what repeats."""

NO_CURRENTS = np.empty((0, 3))
"""Of points of which angle and torque alone are kept."""


@dataclass(frozen=True)
class SeenRipple:
    """Ripple of an operating point: orders 1 to n.

    even_odd_Nm (2, n): complex lines of even and of odd turns; noise_Nm (n,): standard error of
    their mean. band: highest order that the currents follow at this speed, turns_Hz as it was;
    highest: the highest to learn. ripple: the same over all orders, with the lines that are not
    locked to the rotor, whose part is in noise_Nm; None where it was not looked for.
    """

    torque_Nm: float
    speed_Hz: float
    turns_Hz: float
    even_odd_Nm: np.ndarray
    noise_Nm: np.ndarray
    band: int
    highest: int
    ripple: PointRipple | None = None

    @property
    def order(self) -> np.ndarray:
        """The orders (n,)."""
        return np.arange(1, self.noise_Nm.size + 1)

    @property
    def line_Nm(self) -> np.ndarray:
        """Complex amplitudes (n,): order h is Re(line exp(j h theta))."""
        return np.asarray(self.even_odd_Nm.mean(axis=0))


def band_order(samples: Samples, hold: ZeroOrderHold | None) -> int:
    """Return the highest order that the currents follow at this speed.

    A part of the loop's rate, or the corner of the current loops if that is lower.
    """
    band_Hz = BAND_SHARE / samples.period_s
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
    found, detected, turns = [], [], []
    for samples in points:
        found.append(seen_by(samples, motor, sensor, gain, hold, highest_order))
        detected.append(DetectedLines.of(samples, motor.counts))
        turns.append(replace(samples, i_A=NO_CURRENTS, command_A=NO_CURRENTS))
    pairs = zip(found, detected, strict=True)
    plain = [(one.ripple, lines) for one, lines in pairs if one.ripple is not None]
    ripples = with_asynchronous(plain, turns, motor, sensor)
    return [
        replace(
            one,
            noise_Nm=np.hypot(one.noise_Nm, noise_of_lines(ripple, samples, motor, sensor)),
            ripple=ripple,
        )
        for one, ripple, samples in zip(found, ripples, turns, strict=True)
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
    even_odd_Nm = ripple.even_odd_Nm
    if hold is not None:
        even_odd_Nm = even_odd_Nm - aliased_ripple(samples, gain, motor, sensor, hold, ripple.order)
    rms_Nm, stderr_Nm = repeating_rms(even_odd_Nm, ripple.noise_Nm)
    percent, band = 100 / motor.rated_torque_Nm, band_order(samples, hold)
    return SeenRipple(
        torque_Nm=samples.torque_set_Nm,
        speed_Hz=samples.speed_set_Hz,
        turns_Hz=samples.speed_Hz,
        even_odd_Nm=even_odd_Nm,
        noise_Nm=ripple.noise_Nm,
        band=band,
        highest=min(band, highest_order),
        ripple=replace(
            ripple,
            rms_percent=percent * rms_Nm,
            stderr_percent=percent * stderr_Nm,
            noise_stderr_percent=percent * stderr_Nm,
            line_Nm=even_odd_Nm.mean(axis=0),
            even_odd_Nm=even_odd_Nm,
        ),
    )
