"""`motord analyse friction`: friction torque over speed from coast-downs of the free rotor."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from motord.experiments.analysis import Analysis, json_of
from motord.experiments.friction.estimate import measure
from motord.experiments.friction.recordings import coast_downs, inertia_of
from motord.experiments.friction.result import Friction
from motord.experiments.friction.settings import NAME, FrictionConfig
from motord.experiments.subject import Recordings, check_plan, plan_settings
from motord.report.text import TextTable


def estimate(
    recordings: Recordings,
    inertia: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Result of `motord analyse inertia`, JSON."),
    ] = None,
) -> Friction:
    """Return the friction. Raises AnalysisError, ConfigError, IdentifyError, OSError."""
    for run in recordings.runs:
        check_plan(run, NAME)
    known = inertia_of(inertia, plan_settings(recordings, NAME, FrictionConfig))
    motor = recordings.subject.motor
    return measure(tuple(coast_downs(recordings.runs, motor)), motor, known)


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
