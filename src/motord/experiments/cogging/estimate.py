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
    measured = _widened(replace(average(found, motor), left_out=left_out))
    faults = signal_findings((one.label, one.faults) for one in driven)
    return replace(measured, findings=(*findings(measured, recorded_s), *faults))


def average(found: Sequence[SpeedCogging], motor: MotorConfig) -> MeasuredCogging:
    """Average over the speeds at which each order is seen, then over both directions.

    What all orders of a speed share, gain and angle, is in the intervals by `differences`; standard
    errors have what each order differs by besides. Orders that are not allowed and do not stand out
    of their own standard error, which knows how the turns differ, were drift: they are left out.
    """
    poles = 2 * motor.pole_pairs
    order = np.array(sorted({int(order) for one in found for order in one.order}))
    differences, alike = _differences(found)
    ways, own = _each_way(found, order), _each_way(alike, order)
    jerky = any(one.jerky for one in found)
    line_Nm, stderr_Nm = _both_ways(ways[:, 0], own[:, 1].real, jerky=jerky)
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
        directions=_directions(order[kept], ways[..., kept], turns),
        differences=differences,
    )


def _differences(
    found: Sequence[SpeedCogging],
) -> tuple[SpeedDifferences, list[SpeedCogging]]:
    """Return what the orders that stand out at all of the smooth speeds differ by.

    And all speeds without what is common to the orders of each.
    """
    places = [n for n, one in enumerate(found) if not one.jerky and one.turns > 1]
    apart, alike = _common_differences([found[n] for n in places]), list(found)
    for speed, n in enumerate(places[: apart.gains.size]):
        one = found[n]
        line_Nm = apart.without_common(speed, one.line_Nm, one.order)
        alike[n] = replace(one, line_Nm=line_Nm)
    return apart, alike


def _common_differences(speeds: Sequence[SpeedCogging]) -> SpeedDifferences:
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


def _each_way(found: Sequence[SpeedCogging], order: np.ndarray) -> np.ndarray:
    """Return mean and standard error of each order, forwards and backwards (2, 2, n)."""
    ways = [[one for one in found if one.direction == way] for way in (1, -1)]
    return np.array([_mean_lines(way, order) for way in ways])


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


def _both_ways(
    line: np.ndarray, stderr: np.ndarray, *, jerky: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard error (n,) of both directions (2, n), each weighted alike.

    What friction adds turns its sign with the direction, so that it cancels; not so where the rotor
    sticks and slips: then the truth may be anywhere between the two (rectangular, per component).
    """
    seen = np.isfinite(line)
    lines, stderr = np.where(seen, line, 0), np.where(seen, stderr, 0)
    each = 1 / np.maximum(seen.sum(axis=0), 1)
    mean, error = lines.sum(axis=0) * each, np.sqrt((stderr**2).sum(axis=0)) * each
    if jerky:
        apart = np.where(seen.all(axis=0), np.abs(lines[0] - lines[1]), 0) / np.sqrt(24)
        error = np.maximum(error, apart)
    return mean, error


def _directions(
    order: np.ndarray, ways: np.ndarray, turns: Sequence[int]
) -> tuple[DirectionDifference, ...]:
    """Return what the orders (n,) that both directions have differ by: friction and hysteresis.

    ways (2, 2, n): mean and standard error forwards and backwards; turns: of each.
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
