"""Torque ripple over the mesh, and how much of it the sensed currents explain.

Reconstructed torque = sum_p (alpha_p delta_epsilon i*_p + beta_p) k_p + tau_cog: the calibrated
model (Poels 2008, eq. 4.1) fed with the currents that were measured. Its ripple is what current
control left (Poels 2008, Figure 4.11). The residual, what the measured torque has beyond
it, is not in the currents: errors of the current sensors that the model lacks, and of the model.

A loop samples its currents at the end of each of their steps, while the torque answers to the
whole step: sampled currents look older than they are, by about half a period. The age is fitted to
the measured torque, one number a point; without it, an order as high as the cogging's would seem
to have been compensated out of phase.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any, ClassVar

import numpy as np

from motord.calibration import Calibration, RmsErrors
from motord.config import MotorConfig, TorqueSensorConfig
from motord.experiments.analysis import encode
from motord.experiments.captures_left_out import CapturesLeftOut, prepared
from motord.experiments.hold_timing import phase_hold
from motord.experiments.shaft_ripple import shaft_ripple, with_held_images
from motord.experiments.subject import Subject
from motord.findings import Finding
from motord.identification.aliased_ripple import ZeroOrderHold
from motord.identification.disturbances.lines_of_points import DetectedLines, with_asynchronous
from motord.identification.operating_points import Samples, require_currents
from motord.identification.point_ripple import (
    PointRipple,
    point_ripple,
    repeating_rms,
    ripple_of,
    rms_errors,
)
from motord.identification.zero_sequence import is_missing, restored
from motord.recording.captures import captures
from motord.recording.reader import Run


@dataclass(frozen=True)
class Explained:
    """Ripple of an operating point, measured and from its currents.

    sampled_percent: RMS, in percent of rated torque, of the measured ripple as it is sampled,
    without images of held currents between the samples; rest_percent: of this less the
    reconstructed ripple, order by order with their phases. current_age_s: how much older the
    currents are than the recording says.
    """

    JSON: ClassVar = ("reconstructed_percent", "rest_percent", "share_explained", "current_age_s")

    measured: PointRipple
    reconstructed: PointRipple
    sampled_percent: float
    rest_percent: float
    current_age_s: float

    @property
    def reconstructed_percent(self) -> float:
        """RMS error of the reconstructed torque, in percent of rated."""
        return self.reconstructed.rms_percent

    @property
    def share_explained(self) -> float:
        """Part of the sampled ripple's power that the currents explain; below 0 if none."""
        power = self.sampled_percent**2
        return 1.0 - self.rest_percent**2 / power if power > 0 else 0.0


def compensated(points: Sequence[Explained]) -> Sequence[Explained]:
    """Return the points with compensation; all of them where there is none."""
    return [point for point in points if point.measured.compensate] or points


@dataclass(frozen=True)
class MeshRipple:
    """Ripple of each operating point; explained: with the currents' share, where asked for.

    findings: what is questionable about it; scale: standard uncertainty of the torque's scale, in
    parts (Type B), which the standard errors of the JSON hold.
    """

    JSON: ClassVar = ("rms_error_percent", "points")

    ripples: tuple[PointRipple, ...]
    explained: tuple[Explained, ...] = ()
    findings: tuple[Finding, ...] = ()
    scale: float = 0.0

    @property
    def errors(self) -> RmsErrors:
        """RMS errors by set-point, before and after, with their intervals."""
        return rms_errors(self.scaled)

    @property
    def scaled(self) -> list[PointRipple]:
        """The ripples with the uncertainty of the torque's scale."""
        return [one.with_scale_error(self.scale) for one in self.ripples]

    @property
    def rms_error_percent(self) -> dict[str, Any]:
        """The RMS errors as JSON has them."""
        return self.errors.model_dump(mode="json")

    @property
    def points(self) -> list[dict[str, Any]]:
        """The operating points as JSON has them."""
        return [
            {**encode(ripple), **(encode(share) if share else {})}
            for ripple, share in zip_longest(self.scaled, self.explained)
        ]


def ripples(runs: Iterable[Run], subject: Subject, left_out: CapturesLeftOut) -> list[PointRipple]:
    """Return the measured ripple of each good point of the runs that can be used."""
    runs, motor, sensor = tuple(runs), subject.motor, subject.sensor
    found = []
    for samples, hold in _with_holds(runs, subject, left_out):
        held = shaft_ripple(samples, motor, sensor, hold)
        found.append((held, DetectedLines.of(samples, motor.counts)))
    return with_asynchronous(found, _samples(runs, subject, left_out), motor, sensor)


def explained(
    runs: Iterable[Run],
    subject: Subject,
    calibration: Calibration,
    left_out: CapturesLeftOut,
) -> list[Explained]:
    """Return the measured and the reconstructed ripple of each good point that has currents."""
    runs, motor, sensor = tuple(runs), subject.motor, subject.sensor
    found = [
        (
            explain(samples, motor, sensor, calibration, hold),
            DetectedLines.of(samples, motor.counts),
        )
        for samples, hold in _with_holds(runs, subject, left_out, require_currents)
    ]
    plain = [(one.measured, lines) for one, lines in found]
    again = _samples(runs, subject, left_out, require_currents)
    measured = with_asynchronous(plain, again, motor, sensor)
    return [replace(one, measured=point) for (one, _), point in zip(found, measured, strict=True)]


def _samples(
    runs: Iterable[Run],
    subject: Subject,
    left_out: CapturesLeftOut,
    *check: Callable[[Samples], Samples],
) -> Iterator[Samples]:
    points = (point for run in runs for point in captures(run) if not point.induced)
    return prepared(points, subject.motor.counts, left_out, *check)


def _with_holds(
    runs: Iterable[Run],
    subject: Subject,
    left_out: CapturesLeftOut,
    *check: Callable[[Samples], Samples],
) -> Iterator[tuple[Samples, ZeroOrderHold | None]]:
    """Yield the samples of points with the timing of their phase currents, if it is known."""
    for run in runs:
        hold = phase_hold(run)
        for samples in _samples([run], subject, left_out, *check):
            yield samples, hold


def middle_point(places: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the (torque_Nm, speed_Hz) near the middle torque, and of its speeds the middle."""
    torques_Nm = sorted({torque_Nm for torque_Nm, _ in places})
    torque_Nm = torques_Nm[len(torques_Nm) // 2]
    speeds_Hz = sorted(speed_Hz for torque, speed_Hz in places if torque == torque_Nm)
    return torque_Nm, speeds_Hz[(len(speeds_Hz) - 1) // 2]


def explain(
    samples: Samples,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    calibration: Calibration,
    hold: ZeroOrderHold | None = None,
) -> Explained:
    """Return measured and reconstructed ripple of an operating point.

    The residual has both as they are sampled, as currents are not known in between.
    """
    measured = point_ripple(samples, motor, sensor)
    torque_Nm, rate_Nm_per_s = reconstructed_torque(samples, motor, calibration)
    seen = np.ones(measured.order.size)
    plain, slope = (ripple_of(samples, v, seen, motor) for v in (torque_Nm, rate_Nm_per_s))
    missing_Nm = measured.line_Nm - plain.line_Nm
    power = float((np.abs(slope.line_Nm) ** 2).sum())
    age_s = float((slope.line_Nm.conj() * missing_Nm).real.sum() / power) if power > 0 else 0.0
    reconstructed = ripple_of(samples, torque_Nm + age_s * rate_Nm_per_s, seen, motor)
    residual_Nm = measured.even_odd_Nm - reconstructed.even_odd_Nm
    noise_Nm = np.hypot(measured.noise_Nm, reconstructed.noise_Nm)
    rms_Nm, _ = repeating_rms(residual_Nm, noise_Nm)
    held = with_held_images(measured, samples, motor, sensor, hold)
    rest_percent = 100 / motor.rated_torque_Nm * rms_Nm
    return Explained(held, reconstructed, measured.rms_percent, rest_percent, age_s)


def reconstructed_torque(
    samples: Samples, motor: MotorConfig, calibration: Calibration
) -> tuple[np.ndarray, np.ndarray]:
    """Return the torque (n,) that the model makes of the sensed currents.

    And how it changes with the age of the currents (n,), Nm/s: the currents' rates in their place.
    """
    gain = calibration.delta_epsilon * np.array(calibration.alpha)
    back_emf = motor.back_emf_table()[samples.count]
    cogging_Nm = np.array(calibration.tau_cog_Nm)[samples.count]
    if motor.connection == "star" and is_missing(samples):
        samples = restored(samples, gain)
    flowing_A = samples.i_A * gain + np.array(calibration.beta_A)
    rate_A_per_s = np.gradient(samples.i_A, samples.t_s, axis=0) * gain
    return (flowing_A * back_emf).sum(axis=1) + cogging_Nm, (rate_A_per_s * back_emf).sum(axis=1)
