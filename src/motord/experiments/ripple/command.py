"""`motord analyse verify`: the RMS error of the torque before and after compensation."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any

import typer

from motord.calibration import RmsErrors, load
from motord.experiments.analysis import Analysis
from motord.experiments.calibration.content import calibration_report, shares_of
from motord.experiments.calibration.estimate.result import rms_errors
from motord.experiments.calibration.recordings import explained, ripples
from motord.experiments.calibration.report import page
from motord.experiments.ripple.reconstruct import Explained
from motord.experiments.ripple.text import error_table
from motord.experiments.subject import AnalysisError, Recordings
from motord.identification.point_ripple import PointRipple
from motord.report.html import Page
from motord.report.text import Table


@dataclass(frozen=True)
class _Result:
    points: list[PointRipple]
    shares: list[Explained]
    errors: RmsErrors


def estimate(
    recordings: Recordings,
    calibration: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The calibration that was applied: tells how much of the ripple currents explain.",
        ),
    ] = None,
) -> _Result:
    """Return the ripple of each point. Raises AnalysisError, CalibrationError, IdentifyError."""
    runs, subject = recordings.runs, recordings.subject
    shares: list[Explained] = []
    if calibration:
        applied = load(calibration)
        applied.check_motor(subject.motor)
        shares = explained(runs, subject, applied)
    points = [each.measured for each in shares] if calibration else ripples(runs, subject)
    if not points:
        files = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(f"{files}: no good operating point in there")
    return _Result(points, shares, rms_errors(points))


def _report(result: _Result, recordings: Recordings) -> Page:
    return page(
        calibration_report(
            recordings.subject,
            recordings.names,
            None,
            result.points,
            title="Verification of torque ripple",
            shares=shares_of(result.shares),
        )
    )


def _json(result: _Result, recordings: Recordings) -> dict[str, Any]:
    return {
        "schema": "motord.verification/1",
        "bench": recordings.subject.bench,
        "motor": recordings.subject.motor.name,
        "runs": recordings.names,
        "rms_error_percent": result.errors.model_dump(mode="json"),
        "points": [
            {
                "torque_Nm": point.torque_Nm,
                "speed_Hz": point.speed_Hz,
                "compensate": point.compensate,
                "turns": point.turns,
                "rms_percent": point.rms_percent,
                "stderr_percent": point.stderr_percent,
                "raw_percent": point.raw_percent,
                **_share_json(share),
            }
            for point, share in zip_longest(result.points, result.shares)
        ],
    }


def _share_json(share: Explained | None) -> dict[str, float]:
    if share is None:
        return {}
    return {
        "reconstructed_percent": share.reconstructed.rms_percent,
        "rest_percent": share.rest_percent,
        "share_explained": share.share,
        "current_age_s": share.current_age_s,
    }


def _text(result: _Result, _: Recordings) -> Iterator[str | Table]:
    yield from error_table(result.errors)
    if shares := result.shares:
        measured = sum(s.measured.rms_percent for s in shares) / len(shares)
        currents = sum(s.reconstructed.rms_percent for s in shares) / len(shares)
        rest = sum(s.rest_percent for s in shares) / len(shares)
        yield (
            f"mean over the points: measured {measured:.2f} %, from the sensed currents "
            f"{currents:.2f} %, not explained by them {rest:.2f} %"
        )


ANALYSIS = Analysis(estimate, json=_json, report=_report, text=_text)
