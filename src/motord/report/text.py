"""Tables as a terminal shows them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from motord.calibration import RmsErrors
from motord.intervals import half_width_of_largest, plus_minus

WHEN = {"before": "without compensation", "after": "with compensation"}
"""What the RMS errors of a set-point are called in a table."""


@dataclass(frozen=True)
class TextTable:
    """A table of text; left: columns that are set left, the others are set right."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: Sequence[int] = ()


def error_table(errors: RmsErrors, half_widths: RmsErrors) -> Iterator[str | TextTable]:
    """Yield the errors of each set-point with their 95 % intervals, then mean and worst.

    half_widths: of the intervals, for the same points; of a mean it is the mean of them, of the
    worst `half_width_of_largest`.
    """
    measured = [name for name in WHEN if getattr(errors, name) is not None]
    pairs = list(zip(errors.points, half_widths.points, strict=True))
    yield TextTable(
        "RMS error of measured torque, % of rated, 95 %",
        ("torque (Nm)", "speed (Hz)", *(WHEN[name] for name in measured)),
        [
            (
                f"{point.torque_Nm:g}",
                f"{point.speed_Hz:g}",
                *(with_interval(getattr(point, name), getattr(half, name)) for name in measured),
            )
            for point, half in pairs
        ],
    )
    for name in measured:
        figures = [(getattr(point, name), getattr(half, name)) for point, half in pairs]
        values, known = zip(*(one for one in figures if one[0] is not None), strict=True)
        half_width = None if None in known else sum(known) / len(known)
        mean = with_interval(sum(values) / len(values), half_width)
        worst = with_interval(max(values), half_width_of_largest(values, known))
        yield f"{name}: mean {mean} %, worst {worst} %"


def with_interval(value: float | None, half_width: float | None) -> str:
    """Return a figure with half of its interval, or with two decimals if that is not known."""
    if value is None:
        return ""
    return f"{value:.2f}" if half_width is None else plus_minus(value, half_width)
