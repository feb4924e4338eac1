"""`motord analyse inertia`: the moment of inertia, by oscillation or by acceleration."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from motord.calibration import load as load_calibration
from motord.config import AccelerationConfig, OscillationConfig
from motord.experiments.analysis import Analysis, json_of
from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.inertia.acceleration import Acceleration, accelerate
from motord.experiments.inertia.folded_cogging import main_orders
from motord.experiments.inertia.oscillation import Oscillation, combine
from motord.experiments.inertia.releases import Release, find_releases, read_release, waves_of
from motord.experiments.inertia.springs import SpringSetup
from motord.experiments.inertia.torque_step import REQUIRED
from motord.experiments.signal_findings import signal_findings
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
from motord.identification import IdentifyError
from motord.identification.encoder_ticks import countable_ticks
from motord.identification.signal_condition import SignalFault, in_range
from motord.intervals import plus_minus
from motord.recording.reader import Run
from motord.report.text import TextTable
from motord.schema import rows_of

EXPERIMENTS = (Oscillation.experiment, Acceleration.experiment)

SET_UP = ("levers_m", "springs", "bar_inertia_kg_m2", "effective_mass", "stator")
"""Settings that say what was on the rotor."""

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
    if cogging_Nm is not None and not settings.stator:
        raise AnalysisError(
            "the stator was off ([plans.inertia-oscillation] stator = false), so no cogging torque "
            "acted: leave out --calibration, or name a bench file that says stator = true with -c"
        )
    waves = None if cogging_Nm is None else waves_of(cogging_Nm)
    read = partial(read_release, counts=counts, setup=setup, cogging_Nm=waves)
    releases: list[Release] = []
    faults: list[tuple[str, tuple[SignalFault, ...]]] = []
    left_out = CapturesLeftOut()
    for run in runs:
        faults += _read_releases(run, counts, read, releases, left_out)
    with left_out.explaining():
        found = combine(releases, setup, waves)
    return replace(found, more_findings=(*signal_findings(faults), *left_out.findings()))


def _read_releases(
    run: Run,
    counts: int,
    read: Callable[[int, np.ndarray, np.ndarray], Release],
    releases: list[Release],
    left_out: CapturesLeftOut,
) -> list[tuple[str, tuple[SignalFault, ...]]]:
    """Add the releases of a run; return by label what is wrong with their encoder's signal."""
    marked = bool(run.operating_points())
    captures = captured_ticks(run, RELEASE) if marked else _searched(run, counts, left_out)
    seen = []
    for number, ticks in enumerate(captures, start=1):
        label = f"{run.path.name}: release {number}"
        with left_out.noted(label, (run.path, number)):
            good, _, faults = countable_ticks(ticks, counts, label)
            seen.append((label, faults))
            # a segment without oscillation is skipped where a recording marks none
            with nullcontext() if marked else suppress(IdentifyError):
                index = len(releases) + len(left_out.reasons)
                one = read(index, good["t_ns"], good["encoder_count"])
                releases.append(replace(one, label=label))
    return seen


def _searched(run: Run, counts: int, left_out: CapturesLeftOut) -> Iterator[np.ndarray]:
    """Yield what may be releases of the ticks of a recording that marks none."""
    ticks, found = run.ticks(RELEASE), list[slice]()
    with left_out.noted(run.path.name, (run.path, 0)):
        count = ticks["encoder_count"].astype(np.int64)
        ticks = rows_of(ticks, in_range(count, counts, run.path.name))
        found = find_releases(ticks["t_ns"], ticks["encoder_count"], counts)
    for part in found:
        yield ticks[part]


def acceleration(
    runs: Sequence[Run], subject: Subject, settings: AccelerationConfig | None = None
) -> Acceleration:
    """Return the inertia from steps of torque. Raises IdentifyError, AnalysisError."""
    settings = settings or recorded_settings(runs[0], AccelerationConfig)
    counts = subject.motor.counts
    steps = [
        (f"{run.path.name}: step {number}", ticks)
        for run in runs
        for number, ticks in enumerate(captured_ticks(run, REQUIRED), start=1)
    ]
    return accelerate(steps, counts, subject.sensor, settings, main_orders(subject.motor))


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
    named = experiment or (None if command == "inertia" else command)
    found = experiment_of(runs, named)
    if named not in (None, found):
        raise AnalysisError(f"these are recordings of {found}: motord analyse {found} RUN...")
    if found == Acceleration.experiment:
        if calibration:
            raise AnalysisError(
                "--calibration is for releases of a bar: the torque that the sensor measures in "
                "steps has the cogging torque in it"
            )
        pushed = plan_settings(recordings, Acceleration.experiment, AccelerationConfig)
        return acceleration(runs, subject, pushed)
    swung = plan_settings(recordings, Oscillation.experiment, OscillationConfig, *SET_UP)
    if not calibration:
        return oscillation(runs, subject, swung)
    known = load_calibration(calibration)
    known.check_motor(subject.motor, recorded=True)
    return oscillation(runs, subject, swung, np.array(known.tau_cog_Nm))


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
        "other readings of the same recordings, intervals not known",
        ("reading", "J (e-3 kg m2)"),
        [(label, f"{1e3 * reading:#.5g}") for label, reading in readings],
        left=(0,),
    )


ANALYSIS = Analysis(
    estimate,
    json=json_of("motord.inertia/1"),
    text=_text,
    details="-c FILE: a bench file also says what bar and springs are, instead of the recording.",
)
