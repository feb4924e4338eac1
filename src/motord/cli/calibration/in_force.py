"""The calibration that the daemon applies, as a file on this machine."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.console import fail

if TYPE_CHECKING:
    from motord.calibration import Calibration
    from motord.client import Client


CalibrationFile = Annotated[
    Path | None,
    typer.Argument(metavar="[FILE]", help="A calibration file; default: the one in force."),
]


def load_in_force(
    client: "Client", missing: str = "no calibration is in force; name a file, or install one"
) -> "Calibration":
    """Return the calibration that the daemon applies; fail with `missing` if there is none."""
    from motord.calibration import load

    view = client.state().calibration
    if view is None:
        fail(missing)
    if not view.path:
        fail(f"calibration {view.id} is in force, but not written to a file yet: try again")
    return load(Path(view.path))
