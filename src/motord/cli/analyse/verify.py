"""`motord analyse verify`: the RMS error of the torque before and after compensation."""

import json
from typing import TYPE_CHECKING, Any

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
    from motord.analysis import Subject
    from motord.calibration import RmsErrors
    from motord.identify.verify import PointRipple


def verify(
    runs: Runs,
    output: Output = None,
    report: Report = None,
    config: BenchFile = None,
    as_json: AsJson = False,
) -> None:
    """Measure the RMS error of the torque at each operating point, before and after."""
    from motord import analysis
    from motord.identify.result import rms_errors
    from motord.report.calibration import write

    with explained():
        opened, subject = open_runs(runs, config)
        points = analysis.ripples(opened, subject)
        if not points:
            fail(f"{', '.join(map(str, runs))}: no good operating point in there")
        errors = rms_errors(points)
        names = [run.name for run in runs]
        result = _verification(subject, names, errors, points)
        if output:
            output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        if report:
            write(
                report,
                analysis.calibration_report(
                    subject, names, None, points, title="Verification of torque ripple"
                ),
            )
    if as_json:
        print_json(result)
    else:
        print_errors(errors)
        say_files(output, report)


def _verification(
    subject: "Subject", runs: list[str], errors: "RmsErrors", points: "list[PointRipple]"
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
            }
            for point in points
        ],
    }
