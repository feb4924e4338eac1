"""Tables as a terminal shows them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from motord.calibration import RmsErrors
from motord.calibration.parts import RmsSummary
from motord.intervals import NOT_KNOWN, plus_minus, two_digits

WHEN = {"before": "without compensation", "after": "with compensation"}
"""What the RMS errors of a set-point are called in a table."""


@dataclass(frozen=True)
class TextTable:
    """A table of text; left: columns that are set left, the others are set right."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: Sequence[int] = ()


def error_table(errors: RmsErrors) -> Iterator[str | TextTable]:
    """Yield the errors of each set-point with their 95 % intervals, then mean and worst."""
    measured = [name for name in WHEN if getattr(errors, name) is not None]
    yield TextTable(
        "RMS error of measured torque, % of rated, 95 %",
        ("torque (Nm)", "speed (Hz)", *(WHEN[name] for name in measured)),
        [
            (
                f"{point.torque_Nm:g}",
                f"{point.speed_Hz:g}",
                *(
                    with_interval(getattr(point, name), getattr(point, f"{name}_half_width"))
                    for name in measured
                ),
            )
            for point in errors.points
        ],
    )
    for name in measured:
        yield f"{name}: {mean_and_worst(getattr(errors, name))}"


def mean_and_worst(found: RmsSummary) -> str:
    """Return the mean and the largest RMS error with their intervals."""
    mean = with_interval(found.mean, found.mean_half_width, " %")
    return f"mean {mean}, worst {with_interval(found.max, found.max_half_width, ' %')}"


def with_interval(value: float | None, half_width: float | None, unit: str = "") -> str:
    """Return a figure with half of its interval, or that this is not known."""
    if value is None:
        return ""
    if half_width is None:
        return f"{value:.2f}{unit} ({NOT_KNOWN})"
    return f"{plus_minus(value, half_width)}{unit}"


def largest_interval(half_widths: Iterable[float | None], unit: str = " %") -> str:
    """Return a sentence with the largest half of 95 % intervals; None: one that is not known."""
    every = list(half_widths)
    known = [each for each in every if each is not None]
    if not known:
        return "95 % intervals are not known."
    where = "" if len(known) == len(every) else ", where they are known"
    return f"95 % intervals are +-{two_digits(max(known))}{unit} at most{where}."
