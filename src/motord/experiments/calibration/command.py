"""`motord analyse calibrate`: gains, offsets and cogging torque."""

from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

import typer

from motord.calibration import load
from motord.experiments.analysis import Analysis
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.comparison import CalibratedRuns
from motord.experiments.calibration.estimate.result import WITHOUT_LINES
from motord.experiments.subject import Recordings
from motord.intervals import coverage_factor, plus_minus, two_digits
from motord.report.text import TextTable, error_table
from motord.uncertainty_budget import QUANTITIES, Contribution, totals


def estimate(
    recordings: Recordings,
    method: Annotated[
        Literal["joint", "residual"],
        typer.Option(help="joint, or residual: that of Poels 2008, biased, to compare with."),
    ] = "joint",
    beside: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Calibration to compare with in the report.")
    ] = None,
) -> CalibratedRuns:
    """Return the calibration. Raises AnalysisError, CalibrationError, IdentifyError."""
    other = load(beside) if beside else None
    if other is not None:
        other.check_motor(recordings.subject.motor, recorded=True)
    calibrator = Calibrator.of_runs(recordings.runs, recordings.subject, recordings.progress)
    result = calibrator.result(method)
    made = result.to_calibration(recordings.subject.motor, datetime.now(UTC), recordings.names)
    return CalibratedRuns(calibrator, result, made, other)


def _text(found: CalibratedRuns, _: Recordings) -> Iterator[str | TextTable]:
    c = found.calibration
    alpha, beta_A = c.alpha_half_width, c.beta_half_width_A
    yield TextTable(
        f"{c.motor.name}, {c.method} estimator, 95 % (Type A)",
        ("phase", "alpha", "beta (A)"),
        [
            (
                "abc"[phase],
                plus_minus(c.alpha[phase], alpha[phase]),
                plus_minus(c.beta_A[phase], beta_A[phase]),
            )
            for phase in range(3)
        ],
    )
    yield TextTable(
        "cogging torque, 95 % (Type A)",
        ("order", "amplitude (mNm)", "phase (rad)"),
        [(str(h.order), h.in_mNm(), h.phase_text) for h in c.tau_cog_harmonics],
    )
    if c.budget:
        yield _uncertainties(c.budget)
    for note in (*c.observable, *(c.cramer_rao.to_text() if c.cramer_rao else ())):
        yield f"- {note}"
    if (age := found.result.current_delay_s) is not None:
        age_us = plus_minus(1e6 * age[0], 1e6 * coverage_factor(age[2]) * age[1])
        yield f"- currents: {age_us} us older than the recording says (accounted for)"
    yield from error_table(c.rms_error_percent)
    yield f"- {WITHOUT_LINES}"
    if c.serious_findings:
        yield f"to apply it all the same: motord calibration install FILE {c.accept_options}"


def _uncertainties(budget: Sequence[Contribution]) -> TextTable:
    """Return Type A, Type B and both of each quantity, and what most of Type B comes from."""
    others = [one for one in budget if one.type == "B"]
    return TextTable(
        "standard uncertainty, of three phases the largest",
        ("", "Type A", "Type B", "combined", "most of Type B"),
        [
            (
                f"{name} ({unit})",
                *(two_digits(value(total)) for total in totals(budget)),
                _most_of(others, value),
            )
            for name, unit, value in QUANTITIES
        ],
    )


def _most_of(sources: Sequence[Contribution], value: Callable[[Contribution], float]) -> str:
    """Return the name of the source that contributes most, "" if none does."""
    most = max(sources, key=value)
    return most.source if value(most) > 0 else ""


ANALYSIS = Analysis(
    estimate,
    json=lambda found, _: found.calibration.to_json(),
    text=_text,
    save=lambda found, path: found.calibration.save(path),
)
