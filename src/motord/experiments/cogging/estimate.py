"""Cogging torque averaged over speeds, its error at each speed, and compared to a calibration's."""

from collections.abc import Iterable, Sequence

import numpy as np

from motord.calibration import Calibration
from motord.config import MotorConfig, TorqueSensorConfig
from motord.experiments.cogging.at_speed import (
    REQUIRED,
    STANDS_OUT,
    SpeedCogging,
    at_speed,
    standing_out,
)
from motord.experiments.cogging.result import Comparison, MeasuredCogging
from motord.identification import IdentifyError
from motord.identification.driven_rotor import prepare
from motord.identification.operating_points import PointData
from motord.identification.orders import allowed_orders, main_order

SEEN = 5.0
"""Amplitude, in standard errors, from which a harmonic is compared by magnitude and phase."""


def measure(
    points: Iterable[PointData], motor: MotorConfig, sensor: TorqueSensorConfig
) -> MeasuredCogging:
    """Return the cogging torque over all driven points. Raises IdentifyError."""
    driven = [prepare(point, motor, REQUIRED, "no measured torque") for point in points]
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
    kept = allowed | (np.abs(line_Nm) > STANDS_OUT * stderr_Nm)
    return MeasuredCogging(
        motor=motor,
        main_order=main_order(motor.slots, poles),
        order=order[kept],
        line_Nm=line_Nm[kept],
        stderr_Nm=stderr_Nm[kept],
        allowed=allowed[kept],
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


def compare(measured: MeasuredCogging, calibration: Calibration) -> Comparison:
    """Return how a calibration's cogging torque differs. Raises CalibrationError."""
    calibration.check_motor(measured.motor)
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
        label=f"calibration {calibration.id} ({calibration.method})",
        tau_cog_Nm=np.array(calibration.tau_cog_Nm),
        error_percent=error_percent,
        order=order,
        magnitude_percent=100 * (np.abs(ratio) - 1),
        phase_points=np.angle(ratio) / order / (2 * np.pi / counts),
    )
