"""`motord analyse profile`: how torque and speed followed a profile, and the energy."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from motord.calibration import load
from motord.experiments.analysis import Analysis, json_of
from motord.experiments.profile.estimate import measure
from motord.experiments.profile.result import ProfileTracking
from motord.experiments.subject import Recordings
from motord.report.text import TextTable


def estimate(
    recordings: Recordings,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The calibration in force: gains of the currents."),
    ] = None,
) -> ProfileTracking:
    """Return how a profile was followed. Raises AnalysisError, CalibrationError, ConfigError."""
    applied = load(calibration) if calibration else None
    if applied:
        applied.check_motor(recordings.subject.motor, recorded=True)
    return measure(recordings, applied)


def _text(found: ProfileTracking, _: Recordings) -> Iterator[str | TextTable]:
    from motord.experiments.profile.report import HEADER, cycle_rows, mean_rows

    band = f"+-{found.speed_tolerance_Hz:g} Hz, +-{found.torque_tolerance_Nm:g} Nm"
    yield TextTable(f"errors of speed and torque, band {band}", HEADER, cycle_rows(found))
    means = ("mean over the cycles", "95 % interval")
    yield TextTable("energy and means", means, mean_rows(found), (0,))
    for note in found.notes:
        yield f"- {note}"


ANALYSIS = Analysis(
    estimate, json=json_of("motord.profile/1", "name", "serial", "rated_torque_Nm"), text=_text
)
