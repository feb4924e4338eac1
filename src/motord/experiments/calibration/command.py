"""`motord analyse calibrate`: gains, offsets and cogging torque."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from motord.calibration import Calibration, load
from motord.experiments.analysis import Analysis
from motord.experiments.calibration.content import (
    calibration_report,
    estimate_of_calibration,
    estimate_of_result,
)
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.calibration.recordings import calibrator
from motord.experiments.calibration.report import Estimate, page
from motord.experiments.calibration.truth import recorded_truth
from motord.experiments.ripple.text import error_table
from motord.experiments.subject import Recordings
from motord.report.html import Page
from motord.report.text import Table


@dataclass(frozen=True)
class _Result:
    calibrator: Calibrator
    found: CalibrationResult
    calibration: Calibration
    last: Calibration | None


def estimate(
    recordings: Recordings,
    method: Annotated[
        Literal["joint", "residual"],
        typer.Option(help="joint, or residual: that of Poels 2008, biased, to compare with."),
    ] = "joint",
    beside: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Calibration to compare with in the report."),
    ] = None,
) -> _Result:
    """Return the calibration. Raises AnalysisError, CalibrationError, IdentifyError."""
    last = load(beside) if beside else None
    taken = calibrator(recordings.runs, recordings.subject)
    found = taken.result(method)
    made = found.to_calibration(recordings.subject.motor, datetime.now(UTC), recordings.names)
    return _Result(taken, found, made, last)


def _report(result: _Result, recordings: Recordings) -> Page:
    other = result.calibrator.result("residual" if result.found.method == "joint" else "joint")
    return page(
        calibration_report(
            recordings.subject,
            recordings.names,
            result.calibration,
            result.found.ripples,
            [
                estimate_of_result(each, f"{each.method} estimator")
                for each in (result.found, other)
            ],
            _reference(result.last, recordings),
        )
    )


def _reference(last: Calibration | None, recordings: Recordings) -> Estimate | None:
    """Return what to compare with: a calibration that was named, else the truth of a simulation."""
    if last is None:
        return recorded_truth(recordings.runs, recordings.subject)
    last.check_motor(recordings.subject.motor)
    return estimate_of_calibration(last, f"calibration {last.id}")


def _json(result: _Result, _: Recordings) -> dict[str, Any]:
    return result.calibration.to_json()


def _text(result: _Result, _: Recordings) -> Iterator[str | Table]:
    c = result.calibration
    yield Table(
        f"{c.motor.name}, {c.method} estimator",
        ("phase", "alpha", "beta (A)"),
        [
            (
                "abc"[phase],
                f"{c.alpha[phase]:.4f} +- {1.96 * c.alpha_stderr[phase]:.4f}",
                f"{c.beta_A[phase]:.4f} +- {1.96 * c.beta_stderr_A[phase]:.4f}",
            )
            for phase in range(3)
        ],
    )
    yield Table(
        "cogging torque",
        ("order", "amplitude (mNm)", "phase (rad)"),
        [
            (
                str(h.order),
                f"{1e3 * h.amplitude_Nm:.2f} +- {1.96e3 * h.stderr_Nm:.2f}",
                f"{h.phase_rad:.3f}",
            )
            for h in c.tau_cog_harmonics
        ],
    )
    for note in c.observable:
        yield f"- {note}"
    if (delay_s := result.found.current_delay_s) is not None:
        yield (
            f"- currents: {1e6 * delay_s[0]:.0f} +- {1.96e6 * delay_s[1]:.0f} us older than "
            "the recording says (accounted for)"
        )
    yield from error_table(c.rms_error_percent)


ANALYSIS = Analysis(
    estimate,
    json=_json,
    report=_report,
    text=_text,
    save=lambda result, path: result.calibration.save(path),
)
