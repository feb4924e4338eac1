"""Options that commands have in common; those of a connection are in `connection_options`."""

from pathlib import Path
from typing import Annotated, Any

import typer


def bench_file(meaning: str) -> Any:
    """Return the option --config, -c of a command to which it means this."""
    return typer.Option("--config", "-c", metavar="FILE", help=meaning)


def output_file(meaning: str, metavar: str = "FILE") -> Any:
    """Return the option --output, -o of a command to which it means this."""
    return typer.Option("--output", "-o", metavar=metavar, help=meaning)


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
ResultAsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
ReadyAsJson = Annotated[bool, typer.Option("--json", help="Print one line of JSON when ready.")]
Overwrite = Annotated[bool, typer.Option("--force", help="Write over a file that is there.")]
BenchFile = Annotated[Path | None, bench_file("The bench; without it, the simulated one.")]
PlanSettings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a setting, e.g. torques_Nm=1,3."),
]
Detach = Annotated[
    bool, typer.Option("--detach", help="Return at once; the daemon goes on by itself.")
]
Check = Annotated[
    bool,
    typer.Option(
        "--check/--no-check",
        help="Check the calibration before, if the bench file asks for it (check_before_plans).",
    ),
]
Notes = Annotated[str, typer.Option(help="For the recording.")]
Serial = Annotated[
    str | None,
    typer.Option(
        metavar="S",
        help="The motor's serial number, for the recording, where the bench file names none.",
    ),
]
