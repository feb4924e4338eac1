"""`motord analyse`: what recordings tell of the motor and of its torque."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from motord.cli.console import fail, print_json

if TYPE_CHECKING:
    from motord.analysis import Subject
    from motord.calibration import Calibration, RmsErrors, RmsPoint
    from motord.identify.verify import PointRipple
    from motord.record.reader import Run
    from motord.report.calibration import CalibrationReport, Estimate

app = typer.Typer(
    no_args_is_help=True, pretty_exceptions_enable=False, help="Identify, verify, report."
)

Runs = Annotated[list[Path], typer.Argument(metavar="RUN...", help="Recordings, .mcap.")]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write the result, JSON.")
]
Report = Annotated[
    Path | None, typer.Option("--report", metavar="FILE", help="Write a page with pictures, HTML.")
]
BenchFile = Annotated[
    Path | None,
    typer.Option(
        "--config", "-c", metavar="FILE",
        help="Bench file or motor file; without it, what the recordings say of themselves.",
    ),
]  # fmt: skip
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


@app.command()
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

    from motord import analysis
    from motord.calibration import load

    with _explained():
        last = load(beside) if beside else None
        opened, subject = _open(runs, config)
        calibrator = analysis.calibrator(opened, subject)
        result = calibrator.result(method)
        names = [run.name for run in runs]
        calibration = result.to_calibration(subject.motor, datetime.now(UTC), names)
        if output:
            calibration.save(output)
        if report:
            second = calibrator.result("residual" if method == "joint" else "joint")
            estimates = [
                analysis.estimate_of_result(found, f"{found.method} estimator")
                for found in (result, second)
            ]
            reference = _reference(opened, subject, last)
            _write_report(
                report,
                analysis.calibration_report(
                    subject, names, calibration, result.ripples, estimates, reference
                ),
            )
    if as_json:
        print_json(calibration.to_json())
    else:
        _print_calibration(calibration, result.current_delay_s)
        _say_files(output, report)


@app.command()
def verify(
    runs: Runs,
    output: Output = None,
    report: Report = None,
    config: BenchFile = None,
    as_json: AsJson = False,
) -> None:
    """Measure the RMS error of the torque at each operating point, before and after."""
    from motord import analysis
    from motord.identify.result import rms_errors

    with _explained():
        opened, subject = _open(runs, config)
        points = analysis.ripples(opened, subject)
        if not points:
            fail(f"{', '.join(map(str, runs))}: no good operating point in there")
        errors = rms_errors(points)
        names = [run.name for run in runs]
        result = _verification(subject, names, errors, points)
        if output:
            output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        if report:
            _write_report(
                report,
                analysis.calibration_report(
                    subject, names, None, points, title="Verification of torque ripple"
                ),
            )
    if as_json:
        print_json(result)
    else:
        _print_errors(errors)
        _say_files(output, report)


@contextmanager
def _explained() -> Iterator[None]:
    """Turn what can be wrong with the files or the data into one line on stderr."""
    from motord.analysis import AnalysisError
    from motord.calibration import CalibrationError
    from motord.config import ConfigError
    from motord.identify import IdentifyError
    from motord.record.errors import RecordError

    try:
        yield
    except (AnalysisError, CalibrationError, ConfigError, IdentifyError, RecordError) as error:
        fail(str(error))
    except OSError as error:
        fail(f"{error.filename}: {error.strerror}")


def _open(paths: list[Path], config: Path | None) -> "tuple[list[Run], Subject]":
    from motord.analysis import Subject
    from motord.record.reader import open_run

    runs = [open_run(path) for path in paths]
    return runs, Subject.of_file(config) if config else Subject.of_runs(runs)


def _reference(
    runs: "list[Run]", subject: "Subject", last: "Calibration | None"
) -> "Estimate | None":
    """Return what to compare with: a calibration that was named, else the truth of a simulation."""
    from motord.analysis import estimate_of_calibration, recorded_truth

    if last is None:
        return recorded_truth(runs, subject)
    last.check_motor(subject.motor)
    return estimate_of_calibration(last, f"calibration {last.id}")


def _write_report(path: Path, content: "CalibrationReport") -> None:
    from motord.report.calibration import write

    write(path, content)


def _verification(
    subject: "Subject", runs: list[str], errors: "RmsErrors", points: "list[PointRipple]"
) -> dict[str, Any]:
    return {
        "schema": "motord.verification/1",
        "bench": subject.bench,
        "motor": subject.motor.name,
        "runs": runs,
        "rms_error_percent": errors.model_dump(mode="json"),
        "points": [
            {
                "torque_Nm": point.torque_Nm,
                "speed_Hz": point.speed_Hz,
                "compensate": point.compensate,
                "turns": point.turns,
                "rms_percent": point.rms_percent,
                "stderr_percent": point.stderr_percent,
                "raw_percent": point.raw_percent,
            }
            for point in points
        ],
    }


def _print_calibration(calibration: "Calibration", delay_s: tuple[float, float] | None) -> None:
    from rich.console import Console
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
    console = Console()
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
    _print_errors(c.rms_error_percent)


def _print_errors(errors: "RmsErrors") -> None:
    from rich.console import Console
    from rich.table import Table

    points = {(point.torque_Nm, point.speed_Hz): point for point in errors.points}
    speeds_Hz = sorted({speed_Hz for _, speed_Hz in points})
    table = Table(title=f"RMS error of the measured torque, % of rated: {_which(errors)}")
    table.add_column("", justify="right")
    for speed_Hz in speeds_Hz:
        table.add_column(f"{speed_Hz:g} /s", justify="right")
    for torque_Nm in sorted({torque_Nm for torque_Nm, _ in points}):
        row = [points.get((torque_Nm, speed_Hz)) for speed_Hz in speeds_Hz]
        table.add_row(f"{torque_Nm:g} Nm", *(_cell(point) for point in row))
    console = Console()
    console.print(table)
    for name, summary in (("before", errors.before), ("after", errors.after)):
        if summary is not None:
            console.print(f"{name}: mean {summary.mean:.2f} %, worst {summary.max:.2f} %")


def _which(errors: "RmsErrors") -> str:
    if errors.before is not None and errors.after is not None:
        return "before > after"
    return "without compensation" if errors.after is None else "with compensation"


def _cell(point: "RmsPoint | None") -> str:
    values = () if point is None else (point.before, point.after)
    return " > ".join(f"{value:.2f}" for value in values if value is not None)


def _say_files(*files: Path | None) -> None:
    for file in files:
        if file is not None:
            typer.echo(f"wrote {file}")
