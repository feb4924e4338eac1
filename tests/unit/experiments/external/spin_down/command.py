"""`motord analyse spin-down`."""

from dataclasses import dataclass

from motord.experiments.analysis import Analysis, json_of
from motord.experiments.subject import AnalysisError, Recordings
from motord.report.html import Page
from motord.report.text import TextTable


@dataclass(frozen=True)
class SpinDown:
    """How long the rotor turned on in each capture, and how far."""

    time_s: tuple[float, ...]
    turns: tuple[float, ...]


def estimate(recordings: Recordings) -> SpinDown:
    """Return times and turns. Raises AnalysisError."""
    points = [point for run in recordings.runs for point in run.operating_points()]
    if not points:
        raise AnalysisError("no spin-down in there; record one by `motord plan start spin-down`")
    return SpinDown(
        tuple(1e-9 * (point["t_end_ns"] - point["t_start_ns"]) for point in points),
        tuple(point["turns"] for point in points),
    )


def report(found: SpinDown, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Spin-down", recordings.subject.motor.name)
    page.table(["time (s)", "turns"], _rows(found), numbers=True)
    return page


def _rows(found: SpinDown) -> list[list[str]]:
    pairs = zip(found.time_s, found.turns, strict=True)
    return [[f"{time_s:.2f}", f"{turns:.2f}"] for time_s, turns in pairs]


ANALYSIS = Analysis(
    estimate,
    json=json_of("spin-down/1", "name"),
    report=report,
    text=lambda found, _: [TextTable("spin-down", ("time (s)", "turns"), _rows(found))],
)
