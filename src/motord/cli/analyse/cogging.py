"""`motord analyse cogging`: cogging torque of a rotor driven from outside without current."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.atomic_write import write_whole
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
from motord.cli.console import plain_console, print_json

if TYPE_CHECKING:
    from motord.experiments.cogging.average import MeasuredCogging


def cogging(
    runs: Runs,
    output: Output = None,
    report: Report = None,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Calibration whose cogging torque to compare with."),
    ] = None,
    config: BenchFile = None,
    as_json: AsJson = False,
) -> None:
    """Measure the cogging torque from a rotor that was driven without current."""
    from motord.calibration import load
    from motord.experiments.cogging import analysis
    from motord.experiments.cogging.report import write

    with explained():
        beside = load(calibration) if calibration else None
        opened, subject = open_runs(runs, config)
        measured = analysis.measured_cogging(opened, subject)
        comparison = analysis.compared(measured, beside, subject)
        names = [run.name for run in runs]
        result = analysis.cogging_json(subject, names, measured, comparison)
        if output:
            write_whole(output, json.dumps(result, indent=1) + "\n")
        if report:
            content = analysis.cogging_report(subject, names, measured, beside, comparison)
            write(report, content)
    if as_json:
        print_json(result)
    else:
        _print(measured, result)
        say_files(output, report)


def _print(measured: "MeasuredCogging", result: dict[str, Any]) -> None:
    from rich.table import Table

    motor = measured.motor
    table = Table(
        title=f"cogging torque, {motor.slots} slots, {2 * motor.pole_pairs} poles: "
        f"main order {measured.main_order}"
    )
    for heading in ("order", "amplitude (mNm)", "phase (rad)", "allowed"):
        table.add_column(heading, justify="right")
    for h in result["harmonics"]:
        interval = f"{1e3 * h['amplitude_Nm']:.2f} +- {1.96e3 * h['stderr_Nm']:.2f}"
        phase = f"{h['phase_rad']:.3f} +- {1.96 * h['phase_stderr_rad']:.3f}"
        seen = h["amplitude_Nm"] > 3 * h["stderr_Nm"]
        allowed = "yes" if h["allowed"] else "no"
        table.add_row(str(h["order"]), interval, phase if seen else "", allowed)
    console = plain_console()
    console.print(table)
    for speed in result["speeds"]:
        console.print(
            f"- {speed['speed_Hz']:.4g} /s: {speed['turns']} turns, "
            f"within {speed['worst_error_percent']:.2f} % of the average",
            highlight=False,
        )
    if result["comparison"]:
        worst = result["comparison"]["worst_error_percent"]
        name = result["comparison"]["calibration"]
        console.print(
            f"- calibration {name}: within {worst:.2f} % of the measured peak", highlight=False
        )
    for words in result["notes"]:
        console.print(f"- {words}", highlight=False)
