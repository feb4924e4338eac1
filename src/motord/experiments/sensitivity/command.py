"""`motord analyse sensitivity`: what errors of a calibration cost, in theory and in practice."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from motord.calibration import load
from motord.experiments.analysis import Analysis, encode
from motord.experiments.sensitivity.estimate import DEFAULT_TORQUE_Nm, sensitivity, theory_alone
from motord.experiments.sensitivity.result import Again, Sensitivity
from motord.experiments.subject import AnalysisError, Recordings
from motord.intervals import plus_minus
from motord.report.text import TextTable


def estimate(
    recordings: Recordings,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Without recordings: theory for this calibration."),
    ] = None,
    torque_Nm: Annotated[
        float | None,
        typer.Option("--torque", metavar="NM", min=1e-6, help="Set-point of the theory alone."),
    ] = None,
) -> Sensitivity:
    """Return theory and practice. Raises AnalysisError, CalibrationError, IdentifyError."""
    if recordings.runs:
        if calibration is not None or torque_Nm is not None:
            raise AnalysisError(
                "recordings hold calibration and torque themselves: leave out those options"
            )
        return sensitivity(recordings.runs, recordings.subject)
    if calibration is None or recordings.config is None:
        raise AnalysisError(
            "name recordings, or a bench with -c and a calibration with --calibration for theory"
        )
    made, subject = load(calibration), recordings.subject
    made.check_motor(subject.motor)
    table_Nm = np.array(made.tau_cog_Nm)
    return theory_alone(subject, table_Nm, torque_Nm or DEFAULT_TORQUE_Nm)


def _text(result: Sensitivity, _: Recordings) -> Iterator[str | TextTable]:
    theory = result.theory
    yield TextTable(
        f"theory at {theory.torque_Nm:g} Nm, % of rated RMS",
        ("error alone", "at the ends of its interval", "at most 1 %"),
        [
            (
                what,
                ", ".join(f"{value:g}: {percent:.2f}" for value, percent in theory.ends[what]),
                f"{low:.3f} to {high:.3f}",
            )
            for what, (low, high) in theory.within.items()
        ],
        left=(0, 1, 2),
    )
    yield from _practice(result)
    if result.again is not None:
        yield _again(result.again)


def _practice(result: Sensitivity) -> Iterator[str | TextTable]:
    rows = result.slope_rows({one.what: one.what for one in result.series}, "")
    if rows:
        yield TextTable(
            f"measured at {result.theory.torque_Nm:g} Nm, {result.speed_Hz:g} turns/s",
            ("branch", "points", "slope (% per unit)", "theory"),
            rows,
        )


def _again(again: Again) -> TextTable:
    found = again.found
    alpha, beta_A = found.alpha_half_width, found.beta_half_width_A
    assert alpha is not None
    assert beta_A is not None
    return TextTable(
        "errors that were induced, and calibrated again",
        ("phase", "alpha", "found", "beta (A)", "found (A)"),
        [
            (
                "abc"[p],
                f"{again.alpha[p]:.4f}",
                plus_minus(found.alpha[p], alpha[p]),
                f"{again.beta_A[p]:.4g}",
                plus_minus(found.beta_A[p], beta_A[p]),
            )
            for p in range(3)
        ],
    )


ANALYSIS = Analysis(
    estimate,
    json=lambda result, _: {"schema": "motord.sensitivity/1", **encode(result)},
    text=_text,
    needs_recordings=False,
)
