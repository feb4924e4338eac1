"""Cogging torque averaged over speeds, its error at each speed, and beside a calibration's."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from motord.calibration import Calibration
from motord.config import MotorConfig, TorqueSensorConfig
from motord.experiments.cogging.at_speed import (
    STANDS_OUT,
    SpeedCogging,
    at_speed,
    ready,
    standing_out,
)
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData
from motord.identification.orders import allowed_orders, main_order

SEEN = 5.0
"""Amplitude, in standard errors, from which a harmonic is compared by magnitude and phase."""


@dataclass(frozen=True)
class MeasuredCogging:
    """Cogging torque over all speeds.

    order (n,), rising; line_Nm (n,): order h is Re(line exp(j h theta)); stderr_Nm (n,) per
    component; allowed (n,): by slots and poles, the others stand out of the noise; speeds: what
    each speed gave.
    """

    motor: MotorConfig
    main_order: int
    order: np.ndarray
    line_Nm: np.ndarray
    stderr_Nm: np.ndarray
    allowed: np.ndarray
    speeds: tuple[SpeedCogging, ...]

    @property
    def amplitude_Nm(self) -> np.ndarray:
        """Amplitudes (n,) of amplitude sin(order theta + phase)."""
        amplitude: np.ndarray = np.abs(self.line_Nm)
        return amplitude

    @property
    def phase_rad(self) -> np.ndarray:
        """Phases (n,) of amplitude sin(order theta + phase)."""
        phase: np.ndarray = np.angle(1j * self.line_Nm)
        return phase

    @property
    def tau_cog_Nm(self) -> np.ndarray:
        """Cogging torque at the encoder's points (counts,), of the allowed orders."""
        return torque_of(self.order[self.allowed], self.line_Nm[self.allowed], self.motor.counts)

    @property
    def peak_Nm(self) -> float:
        """Largest cogging torque within the turn."""
        return float(np.abs(self.tau_cog_Nm).max())

    def error_percent(self, speed: SpeedCogging) -> np.ndarray:
        """Return the cogging torque at a speed less the average (counts,), % of the peak.

        Poels 2008, Figure 3.4.
        """
        kept = np.isin(speed.order, self.order[self.allowed])
        own_Nm = torque_of(speed.order[kept], speed.line_Nm[kept], self.motor.counts)
        error: np.ndarray = 100 * (own_Nm - self.tau_cog_Nm) / self.peak_Nm
        return error


@dataclass(frozen=True)
class Comparison:
    """A calibration's cogging torque beside the measured one (Poels 2008, Figure 4.5).

    error_percent (counts,): calibrated less measured, % of the measured peak. order (m,): of the
    harmonics that stand out in both; magnitude_percent (m,): calibrated less measured, % of that
    harmonic; phase_points (m,): calibrated less measured, in encoder points.
    """

    calibration: str
    error_percent: np.ndarray
    order: np.ndarray
    magnitude_percent: np.ndarray
    phase_points: np.ndarray

    @property
    def worst_percent(self) -> float:
        """Largest error in the time signal, % of the measured peak."""
        return float(np.abs(self.error_percent).max())


def measure(
    points: Iterable[PointData], motor: MotorConfig, sensor: TorqueSensorConfig
) -> MeasuredCogging:
    """Return the cogging torque over all driven points. Raises IdentifyError."""
    driven = [ready(point, motor) for point in points]
    if not driven:
        raise IdentifyError("there is no good operating point in the recording")
    found = [at_speed(one, motor, sensor) for one in driven]
    others = standing_out(found)
    if others:
        found = [at_speed(one, motor, sensor, others) for one in driven]
    return _average(found, motor)


def _average(found: Sequence[SpeedCogging], motor: MotorConfig) -> MeasuredCogging:
    """Average over the speeds at which each order is seen, by their variances.

    Where the speeds differ by more than their own standard errors explain, that of the average
    grows with what they differ by. Orders that are not allowed and do not stand out of their own
    standard error, which knows how the turns differ, were drift: they are left out.
    """
    poles = 2 * motor.pole_pairs
    order = np.array(sorted({int(order) for one in found for order in one.order}))
    rows = [_mean_line(found, int(h)) for h in order]
    line_Nm, stderr_Nm = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    allowed = np.isin(order, allowed_orders(motor.slots, poles, int(order[-1])))
    told = allowed | (np.abs(line_Nm) > STANDS_OUT * stderr_Nm)
    return MeasuredCogging(
        motor=motor,
        main_order=main_order(motor.slots, poles),
        order=order[told],
        line_Nm=line_Nm[told],
        stderr_Nm=stderr_Nm[told],
        allowed=allowed[told],
        speeds=tuple(found),
    )


def _mean_line(found: Sequence[SpeedCogging], order: int) -> tuple[complex, float]:
    places = [(one, np.flatnonzero(one.order == order)) for one in found]
    lines = np.array([one.line_Nm[place[0]] for one, place in places if place.size])
    stderr = np.array([one.stderr_Nm[place[0]] for one, place in places if place.size])
    weight = 1 / np.maximum(stderr, 1e-300) ** 2
    mean = complex((weight * lines).sum() / weight.sum())
    spread = 1.0
    if lines.size > 1:
        freedom = 2 * (lines.size - 1)
        spread = max(float((weight * np.abs(lines - mean) ** 2).sum()) / freedom, 1.0)
    return mean, float(np.sqrt(spread / weight.sum()))


def torque_of(order: np.ndarray, line_Nm: np.ndarray, counts: int) -> np.ndarray:
    """Return the torque at angles 2 pi n / counts (counts,)."""
    angle_rad = 2 * np.pi * np.arange(counts) / counts
    torque_Nm = np.zeros(counts)
    for h, line in zip(order, line_Nm, strict=True):
        torque_Nm += (line * np.exp(1j * h * angle_rad)).real
    return torque_Nm


def compare(measured: MeasuredCogging, calibration: Calibration) -> Comparison:
    """Return how a calibration's cogging torque differs. Its motor must be the measured one."""
    tau_Nm = np.array(calibration.tau_cog_Nm)
    tau_Nm = tau_Nm - tau_Nm.mean()
    counts = measured.motor.counts
    error_percent = 100 * (tau_Nm - measured.tau_cog_Nm) / measured.peak_Nm
    lines = 2 * np.fft.rfft(tau_Nm)[measured.order] / counts
    seen = measured.allowed & (measured.amplitude_Nm > SEEN * measured.stderr_Nm)
    ratio = lines[seen] / measured.line_Nm[seen]
    order = measured.order[seen]
    return Comparison(
        calibration=calibration.id,
        error_percent=error_percent,
        order=order,
        magnitude_percent=100 * (np.abs(ratio) - 1),
        phase_points=np.angle(ratio) / order / (2 * np.pi / counts),
    )
