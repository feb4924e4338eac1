"""`motord analyse check-calibration`: whether a calibration still holds, by a few fresh turns."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from motord.calibration import load
from motord.experiments.analysis import Analysis, json_of
from motord.experiments.check_calibration.estimate import check_runs
from motord.experiments.check_calibration.result import NEEDED_PERCENT, CalibrationCheck
from motord.experiments.subject import Recordings
from motord.report.text import TextTable


def estimate(
    recordings: Recordings,
    calibration: Annotated[
        Path, typer.Option(metavar="FILE", help="The calibration that was in force.")
    ],
    ripple_percent: Annotated[
        float,
        typer.Option(
            min=0.01,
            help="RMS ripple at rated torque, % of it, that no change may add unseen: else the "
            "verdict is undecided.",
        ),
    ] = NEEDED_PERCENT,
) -> CalibrationCheck:
    """Return the test. Raises AnalysisError, CalibrationError, IdentifyError."""
    return check_runs(recordings, load(calibration), ripple_percent)


def _text(found: CalibrationCheck, _: Recordings) -> Iterator[str | TextTable]:
    yield found.sentence
    yield TextTable(
        f"changes since calibration {found.calibration}, 95 % intervals",
        ("", "change", "limit", "found in 95 %", "unit", ""),
        found.rows(),
        left=(0, 4, 5),
    )
    for what in found.unseen:
        yield f"- not tested: {what}; these turns do not show it"


ANALYSIS = Analysis(
    estimate,
    json=json_of("motord.calibration-check/1", "name", "serial"),
    text=_text,
    details="The verdict is valid, drifted or undecided. A change counts as drift beyond its "
    "limit, which chance alone passes in 0.5 % of checks, over all changes together.",
)
