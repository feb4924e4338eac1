"""`motord analyse sensitivity`: what errors of a calibration cost, in theory and in practice."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from motord.atomic_write import write_whole
from motord.cli.analyse.inputs import (
    AsJson,
    BenchFile,
    Output,
    Report,
    explained,
    open_runs,
    say_files,
)
from motord.cli.console import fail, plain_console, print_json

if TYPE_CHECKING:
    from rich.console import Console

    from motord.experiments.sensitivity.result import Again, Sensitivity


def sensitivity(
    runs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[RUN...]", help="Recordings of the plan `sensitivity`, .mcap."),
    ] = None,
    output: Output = None,
    report: Report = None,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Without recordings: theory for this calibration."),
    ] = None,
    torque_Nm: Annotated[
        float | None,
        typer.Option("--torque", metavar="NM", min=1e-6, help="Set-point of the theory alone."),
    ] = None,
    config: BenchFile = None,
    as_json: AsJson = False,
) -> None:
    """Compare the ripple that induced errors make with theory, and calibrate from them again."""
    from motord.experiments.sensitivity.content import sensitivity_report
    from motord.experiments.sensitivity.report import write

    with explained():
        result = _result(runs or [], config, calibration, torque_Nm)
        if output:
            write_whole(output, json.dumps(result.to_json(), indent=1) + "\n")
        if report:
            write(report, sensitivity_report(result))
    if as_json:
        print_json(result.to_json())
    else:
        _print(result)
        say_files(output, report)


def _result(
    runs: list[Path], config: Path | None, calibration: Path | None, torque_Nm: float | None
) -> "Sensitivity":
    import numpy as np

    from motord.calibration import load
    from motord.experiments.sensitivity import analysis
    from motord.experiments.subject import Subject

    if runs:
        if calibration is not None or torque_Nm is not None:
            fail("recordings tell calibration and torque themselves: leave out those options")
        return analysis.sensitivity(*open_runs(runs, config))
    if calibration is None or config is None:
        fail("name recordings, or a bench with -c and a calibration with --calibration for theory")
    made, subject = load(calibration), Subject.of_file(config)
    made.check_motor(subject.motor)
    table = np.array(made.tau_cog_Nm)
    return analysis.theory_alone(subject, table, torque_Nm or analysis.DEFAULT_TORQUE_Nm)


def _print(result: "Sensitivity") -> None:
    from rich.table import Table

    console = plain_console()
    theory = result.theory
    table = Table(title=f"theory at {theory.torque_Nm:g} Nm, % of rated RMS")
    for heading in ("error alone", "at the ends of its interval", "at most 1 %"):
        table.add_column(heading)
    for what, (low, high) in theory.within.items():
        ends = ", ".join(f"{value:g}: {percent:.2f}" for value, percent in theory.ends[what])
        table.add_row(what, ends, f"{low:.3f} to {high:.3f}")
    console.print(table)
    _print_practice(console, result)
    if result.again is not None:
        _print_again(console, result.again)


def _print_practice(console: "Console", result: "Sensitivity") -> None:
    from rich.table import Table

    rows = [
        (
            f"{one.what} {side}",
            str(int(branch.used.sum())),
            f"{branch.slope:.2f} +- {1.96 * branch.slope_stderr:.2f}",
            f"{branch.theory_slope:.2f}",
        )
        for one in result.series
        for side, branch in zip(("below", "above"), one.branches, strict=True)
        if branch is not None
    ]
    if result.series and not rows:
        console.print("fewer than two points a side are clear of the ripple without any error")
    if rows:
        place = f"{result.theory.torque_Nm:g} Nm, {result.speed_Hz:g} turns/s"
        table = Table(title=f"measured at {place}")
        for heading in ("branch", "points", "slope (% per unit)", "theory"):
            table.add_column(heading, justify="right")
        for row in rows:
            table.add_row(*row)
        console.print(table)


def _print_again(console: "Console", again: "Again") -> None:
    from rich.table import Table

    table = Table(title="errors that were induced, and calibrated again")
    for heading in ("phase", "alpha", "found", "beta (A)", "found (A)"):
        table.add_column(heading, justify="right")
    found = again.found
    for p in range(3):
        table.add_row(
            "abc"[p],
            f"{again.alpha[p]:.4f}",
            f"{found.alpha[p]:.4f} +- {1.96 * found.alpha_stderr[p]:.4f}",
            f"{again.beta_A[p]:.4f}",
            f"{found.beta_A[p]:.4f} +- {1.96 * found.beta_stderr_A[p]:.4f}",
        )
    console.print(table)
