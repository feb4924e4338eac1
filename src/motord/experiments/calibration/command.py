"""`motord analyse calibrate`: gains, offsets and cogging torque."""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from motord.calibration import load
from motord.experiments.analysis import Analysis
from motord.experiments.calibration.estimate.calibrator import CalibratedRuns, Calibrator
from motord.experiments.ripple.command import error_table
from motord.experiments.subject import Recordings
from motord.report.text import TextTable

if TYPE_CHECKING:
    from motord.report.html import Page


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
) -> CalibratedRuns:
    """Return the calibration. Raises AnalysisError, CalibrationError, IdentifyError."""
    other = load(beside) if beside else None
    calibrator = Calibrator.of_runs(recordings.runs, recordings.subject)
    result = calibrator.result(method)
    made = result.to_calibration(recordings.subject.motor, datetime.now(UTC), recordings.names)
    return CalibratedRuns(calibrator, result, made, other)


def _report(found: CalibratedRuns, recordings: Recordings) -> "Page":
    from motord.experiments.calibration.report import report

    return report(found, recordings)


def _text(found: CalibratedRuns, _: Recordings) -> Iterator[str | TextTable]:
    c = found.calibration
    yield TextTable(
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
    yield TextTable(
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
    if (delay_s := found.result.current_delay_s) is not None:
        yield (
            f"- currents: {1e6 * delay_s[0]:.0f} +- {1.96e6 * delay_s[1]:.0f} us older than "
            "the recording says (accounted for)"
        )
    for finding in c.findings or ():
        yield f"- {finding.in_words()}"
    yield from error_table(c.rms_error_percent)
    if c.serious_findings:
        yield f"to apply it all the same: motord calibration install FILE {c.accept_options}"


ANALYSIS = Analysis(
    estimate,
    json=lambda found, _: found.calibration.to_json(),
    report=_report,
    text=_text,
    save=lambda found, path: found.calibration.save(path),
)
