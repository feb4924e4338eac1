"""`motord analyse cogging`: cogging torque of a rotor driven from outside without current."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from motord.calibration import load
from motord.experiments.analysis import Analysis, json_of
from motord.experiments.cogging.at_speed import REQUIRED
from motord.experiments.cogging.estimate import compare, measure
from motord.experiments.cogging.result import MeasuredCogging
from motord.experiments.driven_rotor import driven_points, left_out_lines
from motord.experiments.recording_checks import points_left_out
from motord.experiments.subject import Recordings
from motord.report.text import TextTable


def estimate(
    recordings: Recordings,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Calibration whose cogging torque to compare with."),
    ] = None,
) -> MeasuredCogging:
    """Return the cogging torque. Raises AnalysisError, CalibrationError, IdentifyError."""
    other = load(calibration) if calibration else None
    subject = recordings.subject
    measured = measure(driven_points(recordings.runs, REQUIRED), subject.motor, subject.sensor)
    found = (*measured.findings, *points_left_out(recordings.runs))
    compared = None if other is None else compare(measured, other)
    return replace(measured, findings=found, comparison=compared)


def _text(measured: MeasuredCogging, _: Recordings) -> Iterator[str | TextTable]:
    motor = measured.motor
    yield TextTable(
        f"cogging torque, {motor.slots} slots, {motor.poles} poles: "
        f"main order {measured.main_order}",
        ("order", "amplitude (mNm)", "phase (rad)", "allowed"),
        [(*h.cells, "yes" if h.allowed else "no") for h in measured.harmonics],
    )
    for result in measured.speed_results:
        speed = result.measured
        motion = ", jerky: counted angles" if speed.jerky else ""
        yield (
            f"- {speed.direction * speed.speed_Hz:+.4g} turns/s: {speed.turns} turns{motion}, "
            f"within {result.worst_error_percent:.2f} % of the average, noise included"
        )
    if other := measured.comparison:
        yield (
            f"- calibration {other.calibration}: within {other.worst_percent:.2f} % "
            "of the measured peak, noise included"
        )
    for line in left_out_lines(measured.left_out):
        yield f"- {line}"


ANALYSIS = Analysis(
    estimate,
    json=json_of("motord.cogging/1", "name", "serial", "slots", "poles", "counts"),
    text=_text,
)
