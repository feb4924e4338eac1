"""`motord analyse friction`: friction torque over speed from coast-downs of the free rotor."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import pi, sqrt
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer
from pydantic import BaseModel, Field, ValidationError

from motord.config import MotorConfig, NonNegative, Positive
from motord.experiments.analysis import Analysis, json_of
from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.friction import NAME, FrictionConfig
from motord.experiments.friction.coast_down_rows import CoastDown
from motord.experiments.friction.estimate import measure
from motord.experiments.friction.result import Friction, Inertia
from motord.experiments.signal_findings import signal_findings
from motord.experiments.subject import (
    AnalysisError,
    Recordings,
    captured_ticks,
    check_plan,
    plan_settings,
    require_columns,
)
from motord.findings import Finding
from motord.identification import CaptureError
from motord.identification.encoder_ticks import countable_ticks
from motord.identification.operating_points import good_points
from motord.identification.signal_condition import SignalFault
from motord.recording.reader import Run
from motord.report.text import TextTable
from motord.untrusted import read_bytes

COLUMNS = ("t_ns", "encoder_count", "torque_set_Nm")


class _InertiaFile(BaseModel):
    format: Literal["motord.inertia/1"] = Field(alias="schema")
    motor: str = ""
    inertia_kg_m2: Positive
    uncertainty_kg_m2: NonNegative
    freedom: Annotated[float, Field(gt=0)] | None = None


def inertia_of(file: Path | None, settings: FrictionConfig, motor: str) -> Inertia:
    """Return the inertia of a file that `analyse inertia` wrote, else of the settings.

    Its source says if the file is of a motor of another name than `motor`.

    Raises AnalysisError, OSError.
    """
    if file is not None:
        return _read_inertia(file, motor)
    if not settings.inertia_kg_m2:
        raise AnalysisError(
            "friction follows from the moment of inertia, which is not known: name the result of "
            "`motord analyse inertia -o FILE` with --inertia FILE, or set inertia_kg_m2 in "
            "[plans.friction] and name the bench file with -c"
        )
    uncertainty = settings.inertia_tolerance / sqrt(3)
    return Inertia(settings.inertia_kg_m2, uncertainty, "[plans.friction]")


def _read_inertia(file: Path, motor: str) -> Inertia:
    try:
        found = _InertiaFile.model_validate_json(read_bytes(file))
    except ValidationError:
        raise AnalysisError(f"{file}: is no result of `motord analyse inertia -o FILE`") from None
    source = file.name
    if found.motor and motor and found.motor != motor:
        source += f", of another motor, {found.motor!r}"
    relative = found.uncertainty_kg_m2 / found.inertia_kg_m2
    return Inertia(found.inertia_kg_m2, relative, source, found.freedom)


def coast_downs(
    runs: Sequence[Run], motor: MotorConfig
) -> tuple[tuple[CoastDown, ...], tuple[Finding, ...], CapturesLeftOut]:
    """Return the coast-downs of good quality, findings of their signals, and those left out.

    Raises AnalysisError.
    """
    found: list[CoastDown] = []
    faults: list[tuple[str, tuple[SignalFault, ...]]] = []
    left_out = CapturesLeftOut()
    for run in runs:
        require_columns(run, (*COLUMNS, "plan_point"))
        points = good_points(run.operating_points())
        for point, ticks in zip(points, captured_ticks(run, COLUMNS), strict=True):
            index = int(point["index"])
            label = f"{run.path.name}: coast-down {index + 1}"
            with left_out.noted(label, (run.path, index)):
                if np.any(ticks["torque_set_Nm"] != 0.0):
                    raise CaptureError(f"{label}: a torque was commanded")
                good, _, seen = countable_ticks(ticks, motor.counts, label)
                angle_rad = good["encoder_count"] * (2 * pi / motor.counts)
                place = run.path.name, index
                found.append(CoastDown.of(*place, good["t_ns"], angle_rad, motor.counts))
                faults.append((label, seen))
    return tuple(found), signal_findings(faults), left_out


def estimate(
    recordings: Recordings,
    inertia: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Result of `motord analyse inertia`, JSON.")
    ] = None,
) -> Friction:
    """Return the friction. Raises AnalysisError, ConfigError, IdentifyError, OSError."""
    for run in recordings.runs:
        check_plan(run, NAME)
    motor = recordings.subject.motor
    alike = () if inertia else ("inertia_kg_m2",)
    settings = plan_settings(recordings, NAME, FrictionConfig, *alike)
    known = inertia_of(inertia, settings, motor.name)
    coasts, of_signals, left_out = coast_downs(recordings.runs, motor)
    with left_out.explaining():
        found = measure(coasts, motor, known)
    return replace(found, findings=(*found.findings, *of_signals, *left_out.findings()))


def _text(found: Friction, _: Recordings) -> Iterator[str | TextTable]:
    yield TextTable(
        f"friction from {found.coast_downs} coast-downs, 95 % intervals",
        ("", *(one.direction for one in found.directions)),
        found.part_rows,
        left=(0,),
    )
    for note in found.notes:
        yield f"- {note}"


ANALYSIS = Analysis(
    estimate,
    json=json_of("motord.friction/1", "name", "serial", "slots", "pole_pairs", "counts"),
    text=_text,
    details="The moment of inertia is that of --inertia FILE, else of inertia_kg_m2 in "
    "[plans.friction]: of the bench file of -c, or as recorded.",
)
