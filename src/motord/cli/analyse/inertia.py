"""`motord analyse inertia`: the moment of inertia, by oscillation or by acceleration."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal, cast, get_args

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
from motord.cli.console import fail, plain_console, print_json

Experiment = Literal["inertia-oscillation", "inertia-acceleration"]


def inertia(
    context: typer.Context,
    runs: Runs,
    output: Output = None,
    report: Report = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Calibration that knows the cogging torque, if the stator was on."
        ),
    ] = None,
    experiment: Annotated[
        Experiment | None,
        typer.Option(help="Which it is, for recordings that name no plan: imported ones."),
    ] = None,
    config: BenchFile = None,
    as_json: AsJson = False,
) -> None:
    """Find the moment of inertia from releases of a bar or from steps of torque.

    -c FILE: a bench file also says what bar and springs are, instead of the recording.
    """
    from motord.experiments.inertia import analysis
    from motord.experiments.inertia.content import inertia_report
    from motord.experiments.inertia.report import write

    with explained():
        opened, subject = open_runs(runs, config)
        names = [run.name for run in runs]
        plans = analysis.plans_of(config)
        found = analysis.experiment_of(opened, experiment or _named(context))
        if _named(context) not in (None, found):
            fail(f"these are recordings of {found}: motord analyse {found} RUN...")
        if found == analysis.OSCILLATION:
            swing = plans.inertia_oscillation if plans is not None else None
            swung = analysis.oscillation(opened, subject, swing, _cogging(calibration))
            result = analysis.oscillation_json(swung, subject, names)
            content = inertia_report(subject, names, oscillation=swung) if report else None
        else:
            push = plans.inertia_acceleration if plans is not None else None
            pushed = analysis.acceleration(opened, subject, push)
            result = analysis.acceleration_json(pushed, subject, names)
            content = inertia_report(subject, names, acceleration=pushed) if report else None
        if output:
            write_whole(output, json.dumps(result, indent=1) + "\n")
        if report and content:
            write(report, content)
    if as_json:
        print_json(result)
        return
    _print(result)
    say_files(output, report)


def _named(context: typer.Context) -> Experiment | None:
    """Return which experiment the command is named after, if it is."""
    for name in get_args(Experiment):
        if context.info_name == name:
            return cast("Experiment", name)
    return None


def _cogging(calibration: Path | None) -> Any:
    """Return the cogging torque (counts,) of a calibration, None without one."""
    import numpy as np

    from motord.calibration import load

    return None if calibration is None else np.array(load(calibration).tau_cog_Nm)


def _print(result: dict[str, Any]) -> None:
    from rich.table import Table

    value, u = result["inertia_kg_m2"], result["uncertainty_kg_m2"]
    console = plain_console()
    console.print(
        f"J = {1e3 * value:.4f} +- {1e3 * 1.96 * u:.4f} e-3 kg m2 "
        f"(95 %; {100 * 1.96 * u / value:.2f} %), {result['experiment']}",
        highlight=False,
    )
    if result.get("disturbed"):
        numbers = ", ".join(str(index + 1) for index in result["disturbed"])
        console.print(f"left out, as they fit worse than the others: release {numbers}")
    table = Table(title="where the uncertainty comes from")
    table.add_column("source")
    table.add_column("standard uncertainty, %", justify="right")
    for row in result["budget"]:
        table.add_row(row["source"], f"{100 * row['uncertainty']:.3f}")
    console.print(table)
    table = Table(title="other readings of the same recordings")
    table.add_column("reading")
    table.add_column("J (e-3 kg m2)", justify="right")
    for label, reading in _readings(result):
        table.add_row(label, f"{1e3 * reading:.4f}")
    console.print(table)


def _readings(result: dict[str, Any]) -> list[tuple[str, float]]:
    if "readings" in result:
        return [(row["label"], row["inertia_kg_m2"]) for row in result["readings"]]
    return [
        ("torque as commanded", result["commanded_kg_m2"]),
        ("as commanded, friction neglected, eq. (2.1)", result["plain_kg_m2"]),
    ]
