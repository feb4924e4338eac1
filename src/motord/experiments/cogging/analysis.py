"""Cogging torque from recordings of a driven rotor: result, JSON, content of the report."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from motord.calibration import Calibration
from motord.experiments.calibration.content import facts
from motord.experiments.cogging.at_speed import REQUIRED, SpeedCogging
from motord.experiments.cogging.average import Comparison, MeasuredCogging, compare, measure
from motord.experiments.cogging.report import Beside, CoggingRunReport, HarmonicRow, SpeedRow
from motord.experiments.driven_recordings import driven_points
from motord.experiments.subject import Subject
from motord.identification.orders import periods_per_slot_pitch
from motord.recording.reader import Run

SCHEMA = "motord.cogging/1"

FEW_TURNS = 6
"""Turns in all below which the noise's colour is not known."""


def measured_cogging(runs: Iterable[Run], subject: Subject) -> MeasuredCogging:
    """Return the cogging torque over all driven points. Raises AnalysisError, IdentifyError."""
    points = driven_points(runs, subject, REQUIRED[1:])
    return measure(points, subject.motor, subject.sensor)


def compared(
    measured: MeasuredCogging, calibration: Calibration | None, subject: Subject
) -> Comparison | None:
    """Return the calibration's cogging torque beside the measured. Raises CalibrationError."""
    if calibration is None:
        return None
    calibration.check_motor(subject.motor)
    return compare(measured, calibration)


def cogging_json(
    subject: Subject, runs: Sequence[str], measured: MeasuredCogging, comparison: Comparison | None
) -> dict[str, Any]:
    """Return the result as it is written."""
    motor = subject.motor
    return {
        "schema": SCHEMA,
        "bench": subject.bench,
        "motor": {
            "name": motor.name,
            "serial": motor.serial,
            "slots": motor.slots,
            "poles": 2 * motor.pole_pairs,
            "counts": motor.counts,
        },
        "runs": list(runs),
        "main_order": measured.main_order,
        "periods_per_slot_pitch": periods_per_slot_pitch(motor.slots, 2 * motor.pole_pairs),
        "harmonics": _harmonics(measured),
        "peak_Nm": measured.peak_Nm,
        "tau_cog_Nm": measured.tau_cog_Nm.round(9).tolist(),
        "speeds": [_speed(measured, speed) for speed in measured.speeds],
        "comparison": None if comparison is None else _comparison(comparison),
        "notes": notes(measured),
    }


def notes(measured: MeasuredCogging) -> list[str]:
    """Return what is worth knowing of the result, in words."""
    words = []
    if measured.main_order not in measured.order:
        words.append(
            f"the main order {measured.main_order} is too high for the sampling or the encoder: "
            f"orders are seen up to {min(one.spectrum_Nm.size for one in measured.speeds)}"
        )
    others = measured.order[~measured.allowed]
    if others.size:
        listed = ", ".join(str(order) for order in others)
        words.append(
            f"orders that neither slots nor poles explain stand out of the noise: {listed}"
        )
    if sum(one.turns for one in measured.speeds) < FEW_TURNS:
        words.append("few turns: the standard errors take the noise to be white")
    return words


def _harmonics(measured: MeasuredCogging) -> list[dict[str, Any]]:
    return [
        {
            "order": int(order),
            "amplitude_Nm": float(amplitude_Nm),
            "phase_rad": float(phase_rad),
            "stderr_Nm": float(stderr_Nm),
            "phase_stderr_rad": float(min(stderr_Nm / max(amplitude_Nm, 1e-300), np.pi)),
            "allowed": bool(allowed),
        }
        for order, amplitude_Nm, phase_rad, stderr_Nm, allowed in zip(
            measured.order, measured.amplitude_Nm, measured.phase_rad, measured.stderr_Nm,
            measured.allowed, strict=True,
        )
    ]  # fmt: skip


def _speed(measured: MeasuredCogging, speed: SpeedCogging) -> dict[str, Any]:
    return {
        "speed_set_Hz": speed.speed_set_Hz,
        "speed_Hz": speed.speed_Hz,
        "turns": speed.turns,
        "speed_ripple_percent": 100 * speed.speed_ripple,
        "noise_Nm": float(np.median(speed.noise_Nm)),
        "worst_error_percent": float(np.abs(measured.error_percent(speed)).max()),
        "harmonics": [
            {
                "order": int(order),
                "amplitude_Nm": float(np.abs(line)),
                "phase_rad": float(np.angle(1j * line)),
                "stderr_Nm": float(stderr),
            }
            for order, line, stderr in zip(speed.order, speed.line_Nm, speed.stderr_Nm, strict=True)
        ],
    }


def _comparison(comparison: Comparison) -> dict[str, Any]:
    return {
        "calibration": comparison.calibration,
        "worst_error_percent": comparison.worst_percent,
        "harmonics": [
            {
                "order": int(order),
                "magnitude_error_percent": float(magnitude),
                "phase_error_points": float(points),
            }
            for order, magnitude, points in zip(
                comparison.order,
                comparison.magnitude_percent,
                comparison.phase_points,
                strict=True,
            )
        ],
    }


def cogging_report(
    subject: Subject,
    runs: Sequence[str],
    measured: MeasuredCogging,
    calibration: Calibration | None = None,
    comparison: Comparison | None = None,
) -> CoggingRunReport:
    """Return the content of the report."""
    motor = subject.motor
    return CoggingRunReport(
        title="Cogging torque of a driven rotor",
        lead=f"{motor.name} on bench {subject.bench}",
        facts=facts(None, subject, runs),
        slots=motor.slots,
        poles=2 * motor.pole_pairs,
        main_order=measured.main_order,
        tau_cog_Nm=measured.tau_cog_Nm,
        harmonics=tuple(
            HarmonicRow(int(order), float(amplitude), float(phase), float(stderr), bool(allowed))
            for order, amplitude, phase, stderr, allowed in zip(
                measured.order, measured.amplitude_Nm, measured.phase_rad, measured.stderr_Nm,
                measured.allowed, strict=True,
            )
        ),
        speeds=tuple(
            SpeedRow(
                speed_Hz=speed.speed_Hz,
                turns=speed.turns,
                speed_ripple_percent=100 * speed.speed_ripple,
                spectrum_Nm=np.abs(speed.spectrum_Nm),
                error_percent=measured.error_percent(speed),
            )
            for speed in measured.speeds
        ),
        beside=_beside(calibration, comparison),
    )  # fmt: skip


def _beside(calibration: Calibration | None, comparison: Comparison | None) -> Beside | None:
    if calibration is None or comparison is None:
        return None
    return Beside(
        label=f"calibration {calibration.id} ({calibration.method})",
        tau_cog_Nm=np.array(calibration.tau_cog_Nm),
        error_percent=comparison.error_percent,
        order=comparison.order,
        magnitude_percent=comparison.magnitude_percent,
        phase_points=comparison.phase_points,
    )
