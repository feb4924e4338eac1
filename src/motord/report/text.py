"""Tables as a terminal shows them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from motord.calibration import RmsErrors, RmsPoint, by_magnitude


@dataclass(frozen=True)
class TextTable:
    """A table of text; left: columns that are set left, the others are set right."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: Sequence[int] = ()


def error_table(errors: RmsErrors) -> Iterator[str | TextTable]:
    """Yield the errors by torque and speed, then mean and worst."""
    points = by_magnitude({(point.torque_Nm, point.speed_Hz): point for point in errors.points})
    speeds_Hz = sorted({speed_Hz for _, speed_Hz in points})
    yield TextTable(
        f"RMS error of the measured torque, % of rated: {_which(errors)}",
        ["", *(f"{speed_Hz:g} Hz" for speed_Hz in speeds_Hz)],
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
