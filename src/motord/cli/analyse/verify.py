"""`motord analyse verify`: the RMS error of the torque before and after compensation."""

import json
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.atomic_write import write_whole
from motord.cli.analyse.inputs import (
    AsJson,
    BenchFile,
    Output,
    Report,
    Runs,
    explained,
    open_runs,
    say_files,
)
from motord.cli.analyse.ripple_table import print_errors
from motord.cli.console import fail, print_json

if TYPE_CHECKING:
    from motord.calibration import Calibration, RmsErrors
    from motord.experiments.ripple.reconstruct import Explained
    from motord.experiments.subject import Subject
    from motord.identification.point_ripple import PointRipple
    from motord.recording.reader import Run


def verify(
    runs: Runs,
    output: Output = None,
    report: Report = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The calibration that was applied: tells how much of the ripple currents explain.",
        ),
    ] = None,
    config: BenchFile = None,
    as_json: AsJson = False,
) -> None:
    """Measure the RMS error of the torque at each operating point, before and after."""
    from motord.calibration import load
    from motord.experiments.calibration import content, recordings
    from motord.experiments.calibration.estimate.result import rms_errors
    from motord.experiments.calibration.report import write

    with explained():
        opened, subject = open_runs(runs, config)
        applied = load(calibration) if calibration else None
        shares = _shares(opened, subject, applied) if applied else []
        points = [s.measured for s in shares] if applied else recordings.ripples(opened, subject)
        if not points:
            fail(f"{', '.join(map(str, runs))}: no good operating point in there")
        errors = rms_errors(points)
        names = [run.name for run in runs]
        result = _verification(subject, names, errors, points, shares)
        if output:
            write_whole(output, json.dumps(result, indent=1) + "\n")
        if report:
            write(
                report,
                content.calibration_report(
                    subject,
                    names,
                    None,
                    points,
                    title="Verification of torque ripple",
                    shares=content.shares_of(shares),
                ),
            )
    if as_json:
        print_json(result)
    else:
        print_errors(errors)
        _print_shares(shares)
        say_files(output, report)


def _shares(runs: "list[Run]", subject: "Subject", calibration: "Calibration") -> "list[Explained]":
    from motord.experiments.calibration.recordings import explained

    calibration.check_motor(subject.motor)
    return explained(runs, subject, calibration)


def _share_json(share: "Explained | None") -> dict[str, float]:
    if share is None:
        return {}
    return {
        "reconstructed_percent": share.reconstructed.rms_percent,
        "rest_percent": share.rest_percent,
        "share_explained": share.share,
        "current_age_s": share.current_age_s,
    }


def _print_shares(shares: "list[Explained]") -> None:
    if not shares:
        return
    measured = sum(s.measured.rms_percent for s in shares) / len(shares)
    currents = sum(s.reconstructed.rms_percent for s in shares) / len(shares)
    rest = sum(s.rest_percent for s in shares) / len(shares)
    typer.echo(
        f"mean over the points: measured {measured:.2f} %, from the sensed currents "
        f"{currents:.2f} %, not explained by them {rest:.2f} %"
    )


def _verification(
    subject: "Subject",
    runs: list[str],
    errors: "RmsErrors",
    points: "list[PointRipple]",
    shares: "list[Explained]",
) -> dict[str, Any]:
    return {
        "schema": "motord.verification/1",
        "bench": subject.bench,
        "motor": subject.motor.name,
        "runs": runs,
        "rms_error_percent": errors.model_dump(mode="json"),
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
            for point, share in zip_longest(points, shares)
        ],
    }
