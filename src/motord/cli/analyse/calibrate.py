"""`motord analyse calibrate`: gains, offsets and cogging torque."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from motord.cli.analyse.inputs import (
    AsJson,
    BenchFile,
    Output,
    Report,
    Runs,
    explained,
    open_runs,
    say_files,
)
from motord.cli.analyse.ripple_table import print_errors
from motord.cli.console import plain_console, print_json

if TYPE_CHECKING:
    from motord.calibration import Calibration
    from motord.experiments.calibration.report import Estimate
    from motord.experiments.subject import Subject
    from motord.recording.reader import Run


def calibrate(
    runs: Runs,
    output: Output = None,
    report: Report = None,
    method: Annotated[
        Literal["joint", "residual"],
        typer.Option(help="joint, or residual: that of Poels 2008, biased, to compare with."),
    ] = "joint",
    beside: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Calibration to compare with in the report."),
    ] = None,
    config: BenchFile = None,
    as_json: AsJson = False,
) -> None:
    """Identify gains, offsets and cogging torque; -o writes the calibration file."""
    from datetime import UTC, datetime

    from motord.calibration import load
    from motord.experiments.calibration import content, recordings
    from motord.experiments.calibration.report import write

    with explained():
        last = load(beside) if beside else None
        opened, subject = open_runs(runs, config)
        calibrator = recordings.calibrator(opened, subject)
        result = calibrator.result(method)
        names = [run.name for run in runs]
        calibration = result.to_calibration(subject.motor, datetime.now(UTC), names)
        if output:
            calibration.save(output)
        if report:
            second = calibrator.result("residual" if method == "joint" else "joint")
            estimates = [
                content.estimate_of_result(found, f"{found.method} estimator")
                for found in (result, second)
            ]
            reference = _reference(opened, subject, last)
            write(
                report,
                content.calibration_report(
                    subject, names, calibration, result.ripples, estimates, reference
                ),
            )
    if as_json:
        print_json(calibration.to_json())
    else:
        _print_calibration(calibration, result.current_delay_s)
        say_files(output, report)


def _reference(
    runs: "list[Run]", subject: "Subject", last: "Calibration | None"
) -> "Estimate | None":
    """Return what to compare with: a calibration that was named, else the truth of a simulation."""
    from motord.experiments.calibration.content import estimate_of_calibration
    from motord.experiments.calibration.truth import recorded_truth

    if last is None:
        return recorded_truth(runs, subject)
    last.check_motor(subject.motor)
    return estimate_of_calibration(last, f"calibration {last.id}")


def _print_calibration(calibration: "Calibration", delay_s: tuple[float, float] | None) -> None:
    from rich.table import Table

    c = calibration
    table = Table(title=f"{c.motor.name}, {c.method} estimator")
    for heading in ("phase", "alpha", "beta (A)"):
        table.add_column(heading, justify="right")
    for phase in range(3):
        table.add_row(
            "abc"[phase],
            f"{c.alpha[phase]:.4f} +- {1.96 * c.alpha_stderr[phase]:.4f}",
            f"{c.beta_A[phase]:.4f} +- {1.96 * c.beta_stderr_A[phase]:.4f}",
        )
    console = plain_console()
    console.print(table)
    table = Table(title="cogging torque")
    for heading in ("order", "amplitude (mNm)", "phase (rad)"):
        table.add_column(heading, justify="right")
    for h in c.tau_cog_harmonics:
        interval = f"{1e3 * h.amplitude_Nm:.2f} +- {1.96e3 * h.stderr_Nm:.2f}"
        table.add_row(str(h.order), interval, f"{h.phase_rad:.3f}")
    console.print(table)
    for words in c.observable:
        console.print(f"- {words}", highlight=False)
    if delay_s is not None:
        console.print(
            f"- currents: {1e6 * delay_s[0]:.0f} +- {1.96e6 * delay_s[1]:.0f} us older than "
            "the recording says (accounted for)",
            highlight=False,
        )
    print_errors(c.rms_error_percent)
