"""`motord analyse verify`: the RMS error of the torque before and after compensation."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from motord.calibration import RmsErrors, RmsPoint, by_magnitude, load
from motord.experiments.analysis import Analysis, json_of
from motord.experiments.damaged_recordings import points_left_out
from motord.experiments.ripple.estimate import MeshRipple, explained, ripples
from motord.experiments.ripple_findings import findings
from motord.experiments.subject import AnalysisError, Recordings
from motord.report.text import TextTable


def estimate(
    recordings: Recordings,
    calibration: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The calibration that was applied: shows how much of the ripple currents explain.",
        ),
    ] = None,
) -> MeshRipple:
    """Return the ripple of each point. Raises AnalysisError, CalibrationError, IdentifyError."""
    runs, subject = recordings.runs, recordings.subject
    if calibration:
        applied = load(calibration)
        applied.check_motor(subject.motor, recorded=True)
        shares = tuple(explained(runs, subject, applied))
        measured = tuple(one.measured for one in shares)
    else:
        shares, measured = (), tuple(ripples(runs, subject))
    if not measured:
        files = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(f"{files}: no good operating point in there")
    found = (*findings(measured), *points_left_out(runs))
    return MeshRipple(measured, shares, found, subject.accuracy.torque_scale)


def _text(found: MeshRipple, _: Recordings) -> Iterator[str | TextTable]:
    yield from error_table(found.errors)
    if shares := found.explained:
        measured = sum(s.measured.rms_percent for s in shares) / len(shares)
        currents = sum(s.reconstructed_percent for s in shares) / len(shares)
        residual = sum(s.rest_percent for s in shares) / len(shares)
        yield (
            f"mean over the points: measured {measured:.2f} %, from the sensed currents "
            f"{currents:.2f} %, not explained by them {residual:.2f} %"
        )


def error_table(errors: RmsErrors) -> Iterator[str | TextTable]:
    """Yield the errors by torque and speed, then mean and worst."""
    points = by_magnitude({(point.torque_Nm, point.speed_Hz): point for point in errors.points})
    speeds_Hz = sorted({speed_Hz for _, speed_Hz in points})
    yield TextTable(
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


ANALYSIS = Analysis(estimate, json=json_of("motord.verification/1"), text=_text)
