"""`motord analyse inertia`: the moment of inertia, by oscillation or by acceleration."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer

from motord.calibration import load
from motord.experiments.analysis import Analysis
from motord.experiments.inertia import analysis
from motord.experiments.inertia.content import inertia_report
from motord.experiments.inertia.oscillation import Oscillation
from motord.experiments.inertia.report import page
from motord.experiments.inertia.torque_step import Acceleration
from motord.experiments.subject import AnalysisError, Recordings
from motord.report.html import Page
from motord.report.text import Table


@dataclass(frozen=True)
class _Result:
    oscillation: Oscillation | None = None
    acceleration: Acceleration | None = None


def estimate(
    recordings: Recordings,
    calibration: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Calibration that knows the cogging torque, if the stator was on."
        ),
    ] = None,
    experiment: Annotated[
        Literal["inertia-oscillation", "inertia-acceleration"] | None,
        typer.Option(help="Which it is, for recordings that name no plan: imported ones."),
    ] = None,
    command: str = "inertia",
) -> _Result:
    """Return the moment of inertia. Raises AnalysisError, CalibrationError, IdentifyError."""
    runs, subject = recordings.runs, recordings.subject
    plans = analysis.plans_of(recordings.config)
    named = None if command == "inertia" else command
    found = analysis.experiment_of(runs, experiment or named)
    if named not in (None, found):
        raise AnalysisError(f"these are recordings of {found}: motord analyse {found} RUN...")
    if found == analysis.OSCILLATION:
        settings = plans.inertia_oscillation if plans is not None else None
        cogging_Nm = np.array(load(calibration).tau_cog_Nm) if calibration else None
        return _Result(oscillation=analysis.oscillation(runs, subject, settings, cogging_Nm))
    settings = plans.inertia_acceleration if plans is not None else None
    return _Result(acceleration=analysis.acceleration(runs, subject, settings))


def _json(result: _Result, recordings: Recordings) -> dict[str, Any]:
    subject, names = recordings.subject, recordings.names
    if result.oscillation is not None:
        return analysis.oscillation_json(result.oscillation, subject, names)
    assert result.acceleration is not None
    return analysis.acceleration_json(result.acceleration, subject, names)


def _report(result: _Result, recordings: Recordings) -> Page:
    return page(
        inertia_report(
            recordings.subject,
            recordings.names,
            oscillation=result.oscillation,
            acceleration=result.acceleration,
        )
    )


def _text(found: _Result, recordings: Recordings) -> Iterator[str | Table]:
    result = _json(found, recordings)
    value, u = result["inertia_kg_m2"], result["uncertainty_kg_m2"]
    yield (
        f"J = {1e3 * value:.4f} +- {1e3 * 1.96 * u:.4f} e-3 kg m2 "
        f"(95 %; {100 * 1.96 * u / value:.2f} %), {result['experiment']}"
    )
    if result.get("disturbed"):
        numbers = ", ".join(str(index + 1) for index in result["disturbed"])
        yield f"left out, as they fit worse than the others: release {numbers}"
    yield Table(
        "where the uncertainty comes from",
        ("source", "standard uncertainty, %"),
        [(row["source"], f"{100 * row['uncertainty']:.3f}") for row in result["budget"]],
        left=(0,),
    )
    yield Table(
        "other readings of the same recordings",
        ("reading", "J (e-3 kg m2)"),
        [(label, f"{1e3 * reading:.4f}") for label, reading in _readings(result)],
        left=(0,),
    )


def _readings(result: dict[str, Any]) -> list[tuple[str, float]]:
    if "readings" in result:
        return [(row["label"], row["inertia_kg_m2"]) for row in result["readings"]]
    return [
        ("torque as commanded", result["commanded_kg_m2"]),
        ("as commanded, friction neglected, eq. (2.1)", result["plain_kg_m2"]),
    ]


ANALYSIS = Analysis(
    estimate,
    json=_json,
    report=_report,
    text=_text,
    details="-c FILE: a bench file also says what bar and springs are, instead of the recording.",
)
