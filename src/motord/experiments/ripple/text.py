"""RMS errors of the torque over the mesh, as a terminal shows them."""

from collections.abc import Iterator

from motord.calibration import RmsErrors, RmsPoint
from motord.report.text import Table


def error_table(errors: RmsErrors) -> Iterator[str | Table]:
    """Yield the errors by torque and speed, then mean and worst."""
    points = {(point.torque_Nm, point.speed_Hz): point for point in errors.points}
    speeds_Hz = sorted({speed_Hz for _, speed_Hz in points})
    yield Table(
        f"RMS error of the measured torque, % of rated: {_which(errors)}",
        ["", *(f"{speed_Hz:g} /s" for speed_Hz in speeds_Hz)],
        [
            [f"{torque_Nm:g} Nm", *(_cell(points.get((torque_Nm, at_Hz))) for at_Hz in speeds_Hz)]
            for torque_Nm in sorted({torque_Nm for torque_Nm, _ in points})
        ],
    )
    for name, summary in (("before", errors.before), ("after", errors.after)):
        if summary is not None:
            yield f"{name}: mean {summary.mean:.2f} %, worst {summary.max:.2f} %"


def _which(errors: RmsErrors) -> str:
    if errors.before is not None and errors.after is not None:
        return "before > after"
    return "without compensation" if errors.after is None else "with compensation"


def _cell(point: RmsPoint | None) -> str:
    values = () if point is None else (point.before, point.after)
    return " > ".join(f"{value:.2f}" for value in values if value is not None)
