"""RMS errors of the torque over the mesh, as a table in the terminal."""

from typing import TYPE_CHECKING

from motord.cli.console import plain_console

if TYPE_CHECKING:
    from motord.calibration import RmsErrors, RmsPoint


def print_errors(errors: "RmsErrors") -> None:
    """Print the errors by torque and speed, with mean and worst."""
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
    console = plain_console()
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
