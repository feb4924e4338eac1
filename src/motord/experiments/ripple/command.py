"""`motord analyse verify`: the RMS error of the torque before and after compensation."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from motord.calibration import load
from motord.experiments.analysis import Analysis, json_of
from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.ripple.estimate import MeshRipple, compensated, explained, ripples
from motord.experiments.ripple_findings import findings
from motord.experiments.subject import AnalysisError, Recordings
from motord.report.text import TextTable, error_table


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
    runs, subject, left_out = recordings.runs, recordings.subject, CapturesLeftOut()
    if calibration:
        applied = load(calibration)
        applied.check_motor(subject.motor, recorded=True)
        shares = tuple(explained(runs, subject, applied, left_out))
        measured = tuple(one.measured for one in shares)
    else:
        shares, measured = (), tuple(ripples(runs, subject, left_out))
    if not measured:
        files = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(f"{files}: no good operating point in there{left_out.as_text}")
    found = (*findings(measured), *left_out.findings(runs))
    return MeshRipple(measured, shares, found, subject.accuracy.torque_scale)


def _text(found: MeshRipple, _: Recordings) -> Iterator[str | TextTable]:
    yield from error_table(found.errors)
    if shares := compensated(found.explained):
        which = " with compensation" if shares[0].measured.compensate else ""
        measured = sum(s.sampled_percent for s in shares) / len(shares)
        currents = sum(s.reconstructed_percent for s in shares) / len(shares)
        residual = sum(s.rest_percent for s in shares) / len(shares)
        yield (
            f"mean over the points{which}, as sampled: measured {measured:.2f} %, from the sensed "
            f"currents {currents:.2f} %, not explained by them {residual:.2f} % "
            "(intervals not known)"
        )


ANALYSIS = Analysis(estimate, json=json_of("motord.verification/1"), text=_text)
