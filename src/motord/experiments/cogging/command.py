"""`motord analyse cogging`: cogging torque of a rotor driven from outside without current."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from motord.calibration import Calibration, load
from motord.experiments.analysis import Analysis
from motord.experiments.cogging.analysis import (
    cogging_json,
    cogging_report,
    compared,
    measured_cogging,
)
from motord.experiments.cogging.average import Comparison, MeasuredCogging
from motord.experiments.cogging.report import page
from motord.experiments.subject import Recordings
from motord.report.text import Table


@dataclass(frozen=True)
class _Result:
    measured: MeasuredCogging
    calibration: Calibration | None
    comparison: Comparison | None


def estimate(
    recordings: Recordings,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Calibration whose cogging torque to compare with."),
    ] = None,
) -> _Result:
    """Return the cogging torque. Raises AnalysisError, CalibrationError, IdentifyError."""
    other = load(calibration) if calibration else None
    measured = measured_cogging(recordings.runs, recordings.subject)
    return _Result(measured, other, compared(measured, other, recordings.subject))


def _json(result: _Result, recordings: Recordings) -> dict[str, Any]:
    return cogging_json(recordings.subject, recordings.names, result.measured, result.comparison)


def _text(found: _Result, recordings: Recordings) -> Iterator[str | Table]:
    measured, result = found.measured, _json(found, recordings)
    motor = measured.motor
    yield Table(
        f"cogging torque, {motor.slots} slots, {2 * motor.pole_pairs} poles: "
        f"main order {measured.main_order}",
        ("order", "amplitude (mNm)", "phase (rad)", "allowed"),
        [
            (
                str(h["order"]),
                f"{1e3 * h['amplitude_Nm']:.2f} +- {1.96e3 * h['stderr_Nm']:.2f}",
                f"{h['phase_rad']:.3f} +- {1.96 * h['phase_stderr_rad']:.3f}"
                if h["amplitude_Nm"] > 3 * h["stderr_Nm"]
                else "",
                "yes" if h["allowed"] else "no",
            )
            for h in result["harmonics"]
        ],
    )
    for speed in result["speeds"]:
        yield (
            f"- {speed['speed_Hz']:.4g} /s: {speed['turns']} turns, "
            f"within {speed['worst_error_percent']:.2f} % of the average"
        )
    if other := result["comparison"]:
        yield (
            f"- calibration {other['calibration']}: within {other['worst_error_percent']:.2f} % "
            "of the measured peak"
        )
    for note in result["notes"]:
        yield f"- {note}"


ANALYSIS = Analysis(
    estimate,
    json=_json,
    report=lambda result, recordings: page(
        cogging_report(
            recordings.subject,
            recordings.names,
            result.measured,
            result.calibration,
            result.comparison,
        )
    ),
    text=_text,
)
