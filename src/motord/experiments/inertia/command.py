"""`motord analyse inertia`: the moment of inertia, by oscillation or by acceleration."""

from collections.abc import Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from motord.calibration import load as load_calibration
from motord.config import AccelerationConfig, OscillationConfig
from motord.experiments.analysis import Analysis, json_of
from motord.experiments.inertia.acceleration import Acceleration, accelerate
from motord.experiments.inertia.oscillation import Oscillation, combine
from motord.experiments.inertia.releases import Release, find_releases, read_release, waves_of
from motord.experiments.inertia.springs import SpringSetup
from motord.experiments.inertia.torque_step import REQUIRED
from motord.experiments.signal_findings import with_counts_in_range
from motord.experiments.subject import (
    AnalysisError,
    Recordings,
    Subject,
    captured_ticks,
    check_plan,
    plan_name,
    plan_settings,
    recorded_settings,
)
from motord.findings import Finding
from motord.identification import IdentifyError
from motord.intervals import plus_minus
from motord.recording.reader import Run
from motord.report.text import TextTable

EXPERIMENTS = (Oscillation.experiment, Acceleration.experiment)

RELEASE = ("t_ns", "encoder_count")
"""Columns of the ticks of a release."""


def experiment_of(runs: Sequence[Run], named: str | None = None) -> str:
    """Return which experiment the runs are of; `named` is that of runs that do not say.

    Raises AnalysisError if they are of another, or of both.
    """
    names = {plan_name(run) for run in runs}
    if named is not None and names == {""}:
        return named
    for run in runs:
        check_plan(run, *EXPERIMENTS, hint=", or --experiment to say which it is")
    if len(names) > 1:
        raise AnalysisError("recordings of both experiments for the inertia; analyse them apart")
    if not names:
        raise AnalysisError("no recording")
    return names.pop()


def oscillation(
    runs: Sequence[Run],
    subject: Subject,
    settings: OscillationConfig | None = None,
    cogging_Nm: np.ndarray | None = None,
) -> Oscillation:
    """Return the inertia from releases of a bar between springs.

    settings: what bar and springs are, by default what the recordings say. cogging_Nm (counts,):
    known cogging torque, for a motor whose stator is in place. Raises IdentifyError, AnalysisError.
    """
    settings = settings or recorded_settings(runs[0], OscillationConfig)
    setup = SpringSetup.of(settings)
    counts = subject.motor.counts
    if settings.stator and cogging_Nm is None:
        raise AnalysisError(
            "the stator was in place: its cogging torque pulls as the springs do, and a frequency "
            "cannot separate the two; give a calibration that knows it, or take the stator off"
        )
    waves = waves_of(cogging_Nm) if settings.stator and cogging_Nm is not None else None
    releases: list[Release] = []
    faults: list[Finding] = []
    for run in runs:
        marked = bool(run.operating_points())
        captures = captured_ticks(run, RELEASE) if marked else [run.ticks(RELEASE)]
        what = f"{run.path.name}: {'release' if marked else 'recording'}"
        readable, seen = with_counts_in_range(captures, counts, what)
        faults += seen
        for ticks in readable if marked else _searched(readable[0], counts):
            # a segment without oscillation is skipped where a recording marks none
            with nullcontext() if marked else suppress(IdentifyError):
                place = len(releases), ticks["t_ns"], ticks["encoder_count"]
                releases.append(read_release(*place, counts, setup, waves))
    return replace(combine(releases, setup, waves), of_signals=tuple(faults))


def _searched(ticks: np.ndarray, counts: int) -> Iterator[np.ndarray]:
    """Yield what may be releases of the ticks of a recording that marks none."""
    for part in find_releases(ticks["t_ns"], ticks["encoder_count"], counts):
        yield ticks[part]


def acceleration(
    runs: Sequence[Run], subject: Subject, settings: AccelerationConfig | None = None
) -> Acceleration:
    """Return the inertia from steps of torque. Raises IdentifyError, AnalysisError."""
    settings = settings or recorded_settings(runs[0], AccelerationConfig)
    counts = subject.motor.counts
    captures = (ticks for run in runs for ticks in captured_ticks(run, REQUIRED))
    steps, faults = with_counts_in_range(captures, counts, "step")
    found = accelerate(steps, counts, subject.sensor, settings)
    return replace(found, findings=(*found.findings, *faults))


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
) -> Oscillation | Acceleration:
    """Return the moment of inertia. Raises AnalysisError, CalibrationError, IdentifyError."""
    runs, subject = recordings.runs, recordings.subject
    named = None if command == "inertia" else command
    found = experiment_of(runs, experiment or named)
    if named not in (None, found):
        raise AnalysisError(f"these are recordings of {found}: motord analyse {found} RUN...")
    if found == Acceleration.experiment:
        pushed = plan_settings(recordings, Acceleration.experiment, AccelerationConfig)
        return acceleration(runs, subject, pushed)
    swung = plan_settings(recordings, Oscillation.experiment, OscillationConfig)
    cogging_Nm = np.array(load_calibration(calibration).tau_cog_Nm) if calibration else None
    return oscillation(runs, subject, swung, cogging_Nm)


def _text(found: Oscillation | Acceleration, _: Recordings) -> Iterator[str | TextTable]:
    value = found.inertia_kg_m2
    half = found.half_width_kg_m2
    yield (
        f"J = {plus_minus(1e3 * value, 1e3 * half)} e-3 kg m2 (95 %; {100 * half / value:.2g} %), "
        + found.experiment
    )
    if isinstance(found, Oscillation):
        sources = [(one.source, one.uncertainty) for one in found.budget.shares]
        readings = [(one.label, one.inertia_kg_m2) for one in found.readings]
    else:
        sources = [(one.source, one.uncertainty) for one in found.budget]
        readings = [
            ("torque as commanded", found.commanded_kg_m2),
            ("as commanded, friction neglected, eq. (2.1)", found.plain_kg_m2),
        ]
    yield TextTable(
        "where the uncertainty comes from",
        ("source", "standard uncertainty, %"),
        [(source, f"{100 * uncertainty:.3f}") for source, uncertainty in sources],
        left=(0,),
    )
    yield TextTable(
        "other readings of the same recordings",
        ("reading", "J (e-3 kg m2)"),
        [(label, f"{1e3 * reading:.4f}") for label, reading in readings],
        left=(0,),
    )


ANALYSIS = Analysis(
    estimate,
    json=json_of("motord.inertia/1"),
    text=_text,
    details="-c FILE: a bench file also says what bar and springs are, instead of the recording.",
)
