"""`motord analyse back-emf`: back-EMF of a rotor driven from outside without current."""

import json
from typing import TYPE_CHECKING, Any

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
    from motord.experiments.back_emf.estimate import MeasuredBackEmf


def back_emf(
    runs: Runs,
    output: Output = None,
    report: Report = None,
    config: BenchFile = None,
    as_json: AsJson = False,
) -> None:
    """Measure the back-EMF; -o writes the table that `[motor] back_emf` may name."""
    from motord.experiments.back_emf import analysis
    from motord.experiments.back_emf.report import write

    with explained():
        opened, subject = open_runs(runs, config)
        found = analysis.measured_back_emf(opened, subject)
        names = [run.name for run in runs]
        result = analysis.back_emf_json(subject, names, found)
        if output:
            write_whole(output, json.dumps(result) + "\n")
        if report:
            write(report, analysis.back_emf_report(subject, names, found))
    if as_json:
        print_json(result)
    else:
        _print(found, result)
        say_files(output, report)


def _print(found: "MeasuredBackEmf", result: dict[str, Any]) -> None:
    from rich.table import Table

    table = Table(title=f"back-EMF, {found.motor.name}, mean of the phases")
    for heading in ("order", "amplitude (mV s/rad)", "% of fundamental", "phase (rad)"):
        table.add_column(heading, justify="right")
    for row in result["harmonics"]:
        if row["in_table"]:
            amplitude, error = row["amplitude_V_s_per_rad"], row["stderr_V_s_per_rad"]
            table.add_row(
                str(row["order"]),
                f"{1e3 * amplitude:.3f} +- {1.96e3 * error:.3f}",
                f"{100 * amplitude / found.fundamental:.3f}",
                f"{row['phase_rad']:.4f} +- {1.96 * row['phase_stderr_rad']:.4f}",
            )
    console = plain_console()
    console.print(table)
    if found.delay_s is not None:
        console.print(
            f"- voltages: {1e6 * found.delay_s[0]:.0f} +- {1.96e6 * found.delay_s[1]:.0f} us older "
            "than the recording says (accounted for)",
            highlight=False,
        )
    for words in result["notes"]:
        console.print(f"- {words}", highlight=False)
