"""The ripple of an operating point, freed of what sampling folds into it, and how far to learn."""

from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig, TorqueSensorConfig
from motord.experiments.ilc.zoh_images import ZeroOrderHold, aliased_ripple
from motord.identification import IdentifyError
from motord.identification.operating_points import Samples
from motord.identification.point_ripple import point_ripple

BAND_SHARE = 0.25
"""Part of the loop's rate up to which a correction comes out as it should."""

LEAST_TURNS = 4
"""Whole turns below which noise cannot be separated from what repeats."""


@dataclass(frozen=True)
class SeenRipple:
    """Ripple of an operating point: orders 1 to n.

    even_odd_Nm (2, n): complex lines of even and of odd turns; noise_Nm (n,): standard error of
    their mean. band: highest order that the currents follow at this speed, turns_Hz as it was;
    highest: the highest to learn.
    """

    torque_Nm: float
    speed_Hz: float
    turns_Hz: float
    even_odd_Nm: np.ndarray
    noise_Nm: np.ndarray
    band: int
    highest: int

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


def seen_by(
    samples: Samples,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    gain: np.ndarray,
    hold: ZeroOrderHold | None,
    highest_order: int,
) -> SeenRipple:
    """Return the ripple of a point; gain (3,): what flows over what is commanded.

    Raises IdentifyError where noise cannot be separated from it.
    """
    if len(samples.turns) < LEAST_TURNS:
        raise IdentifyError(
            f"{samples.label}: {len(samples.turns)} whole turns, at least {LEAST_TURNS} to learn"
        )
    ripple = point_ripple(samples, motor, sensor)
    even_odd_Nm = ripple.even_odd_Nm
    if hold is not None:
        even_odd_Nm = even_odd_Nm - aliased_ripple(samples, gain, motor, sensor, hold, ripple.order)
    band = band_order(samples, hold)
    return SeenRipple(
        torque_Nm=samples.torque_set_Nm,
        speed_Hz=samples.speed_set_Hz,
        turns_Hz=samples.speed_Hz,
        even_odd_Nm=even_odd_Nm,
        noise_Nm=ripple.noise_Nm,
        band=band,
        highest=min(band, highest_order),
    )
