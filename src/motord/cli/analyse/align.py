"""`motord analyse align`: phase order, encoder direction and encoder zero."""

import json
from pathlib import Path
from typing import Annotated, Any

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
from motord.cli.console import print_json


def align(
    runs: Runs,
    output: Output = None,
    report: Report = None,
    write: Annotated[
        Path | None,
        typer.Option(metavar="BENCH.toml", help="Write what was found into [motor] of this file."),
    ] = None,
    config: BenchFile = None,
    as_json: AsJson = False,
) -> None:
    """Find phase order, encoder direction and encoder zero from a run of the plan align."""
    from motord.experiments.alignment import analysis
    from motord.experiments.alignment.report import write as write_report

    with explained():
        opened, subject = open_runs(runs, config)
        names = [run.name for run in runs]
        found = analysis.found_alignment(opened, subject)
        result = analysis.align_json(subject, names, found)
        if write:
            _write_fields(write, result["fields"])
        if output:
            write_whole(output, json.dumps(result, indent=1) + "\n")
        if report:
            write_report(report, analysis.align_report(subject, names, found))
    if as_json:
        print_json(result)
        return
    _print(result)
    say_files(output, report, write)


def _write_fields(path: Path, fields: dict[str, Any]) -> None:
    """Change the bench file in one step, once it is sure that it can be read afterwards."""
    from motord.config import read_toml
    from motord.config.editing import with_values

    text, _ = read_toml(path)
    write_whole(path, with_values(text, "motor", fields, str(path)))


def _print(result: dict[str, Any]) -> None:
    error = 1.96 * result["encoder_offset_stderr_rad"]
    points = 1.96 * result["encoder_offset_stderr_points"]
    fields = result["fields"]
    typer.echo("[motor]")
    typer.echo(f'phase_order = "{fields["phase_order"]}"')
    typer.echo(f"encoder_direction = {fields['encoder_direction']}")
    typer.echo(
        f"encoder_offset_rad = {fields['encoder_offset_rad']}  "
        f"# +- {error:.2g} (95 %), {points:.2f} encoder points"
    )
    for words in (
        f"the rotor turns 1/{result['pole_pairs']:.3f} of a turn for each electrical turn",
        f"friction leaves {1e3 * result['friction_Nm']:.0f} mNm at rest: a single stop is "
        f"{result['friction_points']:.2f} encoder points off",
        *result["notes"],
    ):
        typer.echo(f"- {words}")
