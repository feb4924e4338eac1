"""Options that commands have in common; those of a connection are in `connection_options`."""

from pathlib import Path
from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
ResultAsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
BenchFile = Annotated[
    Path | None,
    typer.Option(
        "--config", "-c", metavar="FILE", help="The bench; without it, the simulated one."
    ),
]
PlanSettings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a setting, e.g. torques_Nm=1,3."),
]
