"""Cogging torque averaged over speeds, its error at each speed, and compared to a calibration's."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

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
from motord.experiments.cogging.eccentricity import RARE, eccentricities
from motord.experiments.cogging.findings import findings
from motord.experiments.cogging.result import Comparison, DirectionDifference, MeasuredCogging
from motord.experiments.signal_findings import signal_findings
from motord.identification.operating_points import PointData
from motord.identification.orders import allowed_orders, main_order
from motord.identification.rotor.driven_rotor import prepare
from motord.identification.speed_differences import SpeedDifferences, speed_differences
from motord.intervals import SERIOUS_BIAS, coverage_factor, f_quantile

SEEN = 5.0
"""Amplitude, in standard errors, from which a harmonic is compared by magnitude and phase."""


def measure(
    points: Iterable[PointData], motor: MotorConfig, sensor: TorqueSensorConfig
) -> MeasuredCogging:
    """Return the cogging torque over all driven points. Raises IdentifyError."""
    driven, left_out = prepare(points, motor, REQUIRED, "no measured torque")
    found = [at_speed(one, motor, sensor) for one in driven]
    others = standing_out(found)
    if others:
        found = [at_speed(one, motor, sensor, others) for one in driven]
    recorded_s = sum(float(one.t_s[-1] - one.t_s[0]) for one in driven)
    measured = _widened(replace(_average(found, motor), left_out=left_out))
    faults = signal_findings((one.label, one.faults) for one in driven)
    return replace(measured, findings=(*findings(measured, recorded_s), *faults))


def _average(found: Sequence[SpeedCogging], motor: MotorConfig) -> MeasuredCogging:
    """Average over the speeds at which each order is seen, then over both directions.

    Orders that are not allowed and do not stand out of their own standard error, which knows how
    the turns differ, were drift: they are left out.
    """
    poles = 2 * motor.pole_pairs
    order = np.array(sorted({int(order) for one in found for order in one.order}))
    ways = [_mean_lines([one for one in found if one.direction == way], order) for way in (1, -1)]
    line_Nm, stderr_Nm = _both_ways(ways, jerky=any(one.jerky for one in found))
    allowed = np.isin(order, allowed_orders(motor.slots, poles, int(order[-1])))
    kept = allowed | (np.abs(line_Nm) > STANDS_OUT * stderr_Nm)
    turns = [sum(one.turns for one in found if one.direction == way) for way in (1, -1)]
    return MeasuredCogging(
        motor=motor,
        main_order=main_order(motor.slots, poles),
        order=order[kept],
        line_Nm=line_Nm[kept],
        stderr_Nm=stderr_Nm[kept],
        allowed=allowed[kept],
        speeds=tuple(found),
        directions=_directions(order[kept], [way[:, kept] for way in ways], turns),
        differences=_differences(found),
    )


def _differences(found: Sequence[SpeedCogging]) -> SpeedDifferences:
    """Return what the orders that stand out at all of the smooth speeds differ by."""
    speeds = [one for one in found if not one.jerky and one.turns > 1]
    if len(speeds) < 2:
        return SpeedDifferences()
    strong = [
        one.order[np.abs(one.line_Nm) > STANDS_OUT * one.stderr_Nm].tolist() for one in speeds
    ]
    order = np.array(sorted(set(strong[0]).intersection(*strong[1:])))
    if not order.size:
        return SpeedDifferences()
    places = [np.searchsorted(one.order, order) for one in speeds]
    return speed_differences(
        np.array([one.line_Nm[at] for one, at in zip(speeds, places, strict=True)]),
        np.array([one.stderr_Nm[at] for one, at in zip(speeds, places, strict=True)]),
        order,
        np.array([2 * np.pi * one.direction * one.speed_Hz for one in speeds]),
        min(one.turns for one in speeds) - 1,  # weights by few turns are noisy themselves
    )


def _widened(measured: MeasuredCogging) -> MeasuredCogging:
    """Return it with intervals that hold what the encoder's errors take off the orders."""
    allowed, freedom = measured.order[measured.allowed], measured.degrees_of_freedom
    found = tuple(eccentricities(measured.speeds, allowed, freedom))
    if not found:
        return measured
    size_Nm, half_Nm = measured.amplitude_Nm, measured.half_width_Nm
    least = [(one.lost(measured.order) * size_Nm)[measured.allowed] for one in found]
    most_Nm = sum(one.lost(measured.order, at_most=True) * size_Nm for one in found)
    stderr_Nm = measured.stderr_Nm + most_Nm / coverage_factor(freedom)
    return replace(
        measured,
        stderr_Nm=np.where(measured.allowed, stderr_Nm, measured.stderr_Nm),
        encoder=tuple(
            replace(one, serious=bool((lost > SERIOUS_BIAS * half_Nm[measured.allowed]).any()))
            for one, lost in zip(found, least, strict=True)
        ),
    )


def _mean_lines(found: Sequence[SpeedCogging], order: np.ndarray) -> np.ndarray:
    """Return mean and standard error of each order (2, n), nan where none of the speeds has it.

    By the variances of the speeds; where these differ by more than their own standard errors
    explain, that of the mean grows with what they differ by.
    """
    return np.array([_mean_line(found, int(h)) for h in order], complex).reshape(-1, 2).T


def _mean_line(found: Sequence[SpeedCogging], order: int) -> tuple[complex, float]:
    places = [(one, np.flatnonzero(one.order == order)) for one in found]
    lines = np.array([one.line_Nm[place[0]] for one, place in places if place.size])
    stderr = np.array([one.stderr_Nm[place[0]] for one, place in places if place.size])
    if not lines.size:
        return complex(np.nan, np.nan), float(np.nan)
    weight = 1 / np.maximum(stderr, 1e-300) ** 2
    mean = complex((weight * lines).sum() / weight.sum())
    spread = 1.0
    if lines.size > 1:
        freedom = 2 * (lines.size - 1)
        spread = max(float((weight * np.abs(lines - mean) ** 2).sum()) / freedom, 1.0)
    return mean, float(np.sqrt(spread / weight.sum()))


def _both_ways(ways: Sequence[np.ndarray], *, jerky: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard error (n,) of both directions, each weighted alike.

    What friction adds turns its sign with the direction, so that it cancels; not so where the rotor
    sticks and slips: then the truth may be anywhere between the two (rectangular, per component).
    """
    seen = np.isfinite([way[0] for way in ways])
    lines = np.where(seen, [way[0] for way in ways], 0)
    stderr = np.where(seen, [way[1].real for way in ways], 0)
    each = 1 / np.maximum(seen.sum(axis=0), 1)
    mean, error = lines.sum(axis=0) * each, np.sqrt((stderr**2).sum(axis=0)) * each
    if jerky:
        apart = np.where(seen.all(axis=0), np.abs(lines[0] - lines[1]), 0) / np.sqrt(24)
        error = np.maximum(error, apart)
    return mean, error


def _directions(
    order: np.ndarray, ways: Sequence[np.ndarray], turns: Sequence[int]
) -> tuple[DirectionDifference, ...]:
    """Return what the orders (n,) that both directions have differ by: friction and hysteresis.

    ways: mean and standard error (2, n) forwards and backwards; turns: of each.
    """
    (there, there_Nm), (back, back_Nm) = ways
    freedom = max(sum(turns) - 2, 1)
    stderr_Nm = np.hypot(there_Nm.real, back_Nm.real)
    both = np.flatnonzero(np.isfinite(there) & np.isfinite(back))
    factor = float(np.sqrt(2 * f_quantile(1 - RARE / max(both.size, 1), 2, freedom)))
    return tuple(
        DirectionDifference(
            order=int(order[n]),
            forward_Nm=float(abs(there[n])),
            backward_Nm=float(abs(back[n])),
            phase_rad=float(np.angle(there[n] * back[n].conj())),
            difference_Nm=float(abs(there[n] - back[n])),
            stderr_Nm=float(stderr_Nm[n]),
            limit_Nm=factor * float(stderr_Nm[n]),
        )
        for n in both
    )


def compare(measured: MeasuredCogging, calibration: Calibration) -> Comparison:
    """Return how a calibration's cogging torque differs. Raises CalibrationError."""
    calibration.check_motor(measured.motor, recorded=True)
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
