"""The moment of inertia from recordings of `inertia-oscillation` or `inertia-acceleration`."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from motord.config import (
    AccelerationConfig,
    MotorFile,
    OscillationConfig,
    PlansConfig,
    Section,
    load,
    read_toml,
)
from motord.experiments.inertia.find import find_releases
from motord.experiments.inertia.oscillation import (
    Oscillation,
    Release,
    combine,
    read_release,
    waves_of,
)
from motord.experiments.inertia.springs import SpringSetup
from motord.experiments.inertia.torque_step import Acceleration, PushData, accelerate
from motord.experiments.subject import AnalysisError, Subject
from motord.identification import IdentifyError
from motord.identification.operating_points import good_points
from motord.recording.reader import Run

OSCILLATION = "inertia-oscillation"
ACCELERATION = "inertia-acceleration"

_Settings = TypeVar("_Settings", bound=Section)


def experiment_of(runs: Sequence[Run], named: str | None = None) -> str:
    """Return which experiment the runs are of; `named` is that of runs that do not say.

    Raises AnalysisError if they are of another, or of both.
    """
    unnamed = all(not run.metadata.get("plan", {}).get("name") for run in runs)
    if named is not None and unnamed and runs:
        return named
    names = {str(run.metadata.get("plan", {}).get("name", "")) for run in runs}
    for known in (OSCILLATION, ACCELERATION):
        if names == {known}:
            return known
    if names == {OSCILLATION, ACCELERATION}:
        raise AnalysisError("recordings of both experiments for the inertia; analyse them apart")
    for run in runs:
        name = str(run.metadata.get("plan", {}).get("name", ""))
        if name not in (OSCILLATION, ACCELERATION):
            if name:
                said, hint = f"is of the plan {name}", ""
            else:
                said, hint = "names no plan", ", or --experiment to say which it is"
            needed = f"{OSCILLATION} or {ACCELERATION}"
            raise AnalysisError(f"{run.path}: {said}; needed: {needed}{hint}")
    raise AnalysisError("no recording")


def plans_of(path: Path | None) -> PlansConfig | None:
    """Return `[plans.*]` of a bench file; None for a motor file, which has none, or no file.

    Raises ConfigError.
    """
    if path is None or set(read_toml(path)[1]) <= set(MotorFile.model_fields):
        return None
    return load(path).plans


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
    settings = settings or _recorded(runs[0], OscillationConfig)
    setup = SpringSetup.of(settings)
    counts = subject.motor.counts
    if settings.stator and cogging_Nm is None:
        raise AnalysisError(
            "the stator was in place: its cogging torque pulls as the springs do, and a swing "
            "cannot tell the two apart; give a calibration that knows it, or take the stator off"
        )
    waves = waves_of(cogging_Nm) if settings.stator and cogging_Nm is not None else None
    releases: list[Release] = []
    for run in runs:
        if run.operating_points():
            for ticks in _captures(run, ("t_ns", "encoder_count")):
                place = len(releases), ticks["t_ns"], ticks["encoder_count"]
                releases.append(read_release(*place, counts, setup, waves))
        else:
            releases += _searched(run, counts, setup, waves, len(releases))
    return combine(releases, setup, waves)


def _searched(
    run: Run, counts: int, setup: SpringSetup, waves: np.ndarray | None, first: int
) -> list[Release]:
    """Return the releases of a recording that marks none; what is no swing is passed over."""
    ticks = run.ticks(("t_ns", "encoder_count"))
    found: list[Release] = []
    for part in find_releases(ticks["t_ns"], ticks["encoder_count"], counts):
        place = first + len(found), ticks["t_ns"][part], ticks["encoder_count"][part]
        with suppress(IdentifyError):
            found.append(read_release(*place, counts, setup, waves))
    return found


def acceleration(
    runs: Sequence[Run], subject: Subject, settings: AccelerationConfig | None = None
) -> Acceleration:
    """Return the inertia from steps of torque. Raises IdentifyError, AnalysisError."""
    settings = settings or _recorded(runs[0], AccelerationConfig)
    columns = ("t_ns", "encoder_count", "torque_Nm", "torque_set_Nm")
    pushes = [
        PushData(number, *(ticks[name] for name in columns))
        for number, ticks in enumerate(t for run in runs for t in _captures(run, columns))
    ]
    return accelerate(pushes, subject.motor.counts, subject.sensor, settings)


def _recorded(run: Run, kind: type[_Settings]) -> _Settings:
    """Return the settings that the plan ran with. Raises AnalysisError if they are not there."""
    given = run.metadata.get("plan", {}).get("settings", {})
    known = {name: value for name, value in given.items() if name in kind.model_fields}
    try:
        return kind.model_validate(known)
    except ValueError:
        raise AnalysisError(
            f"{run.path}: its plan's settings cannot be read; name a bench file with -c"
        ) from None


def _captures(run: Run, columns: tuple[str, ...]) -> Iterator[np.ndarray]:
    """Yield the ticks of each good operating point, in time order."""
    for point in good_points(run.operating_points()):
        ticks = run.ticks(
            ("plan_point", *columns),
            from_ns=int(point["t_start_ns"]),
            to_ns=int(point["t_end_ns"]),
        )
        yield ticks[ticks["plan_point"] == int(point["index"])]


def oscillation_json(found: Oscillation, subject: Subject, runs: Sequence[str]) -> dict[str, Any]:
    """Return the result as JSON values."""
    b = found.budget
    return {
        "schema": "motord.inertia/1",
        "experiment": OSCILLATION,
        "bench": subject.bench,
        "motor": subject.motor.name,
        "runs": list(runs),
        "inertia_kg_m2": b.inertia_kg_m2,
        "uncertainty_kg_m2": b.uncertainty_kg_m2,
        "interval_95_kg_m2": list(b.interval_kg_m2),
        "monte_carlo": {"mean_kg_m2": b.mean_kg_m2, "std_kg_m2": b.std_kg_m2, "draws": b.draws},
        "effective_mass": found.setup.effective_mass,
        "effective_mass_factor": found.setup.factors(found.frequency_rad_s).tolist(),
        "stiffness_Nm_per_rad": found.setup.stiffness_Nm,
        "frequency_rad_s": found.frequency_rad_s,
        "frequency_stderr_rad_s": found.frequency_stderr_rad_s,
        "damping_ratio": found.damping_ratio,
        "budget": [
            {
                "source": s.source,
                "inputs": s.inputs,
                "half_width" if s.source != "frequency" else "standard_error": s.half_width,
                "sensitivity": s.sensitivity,
                "uncertainty": s.uncertainty,
            }
            for s in b.shares
        ],
        "disturbed": [release.index for release in found.disturbed],
        "readings": [
            {"label": r.label, "inertia_kg_m2": r.inertia_kg_m2, "std_kg_m2": r.std_kg_m2}
            for r in found.readings
        ],
        "improvements": [
            {"label": i.label, "period_s": i.period_s, "uncertainty": i.uncertainty}
            for i in found.improvements
        ],
        "releases": [
            {
                "index": r.index,
                "period_s": r.five.period_s,
                "decrement": r.five.decrement,
                "damping_ratio": r.five.damping_ratio,
                "frequency_rad_s": r.decay.frequency_rad_s,
                "frequency_stderr_rad_s": r.decay.frequency_stderr_rad_s,
                "cubic_per_rad2": r.decay.cubic_per_rad2,
                "viscous_per_s": r.decay.viscous_per_s,
                "coulomb_rad_s2": r.decay.coulomb_rad_s2,
            }
            for r in found.releases
        ],
    }


def acceleration_json(found: Acceleration, subject: Subject, runs: Sequence[str]) -> dict[str, Any]:
    """Return the result as JSON values."""
    return {
        "schema": "motord.inertia/1",
        "experiment": ACCELERATION,
        "bench": subject.bench,
        "motor": subject.motor.name,
        "runs": list(runs),
        "inertia_kg_m2": found.inertia_kg_m2,
        "uncertainty_kg_m2": found.uncertainty_kg_m2,
        "commanded_kg_m2": found.commanded_kg_m2,
        "plain_kg_m2": found.plain_kg_m2,
        "budget": [{"source": s.source, "uncertainty": s.uncertainty} for s in found.sources],
        "steps": [
            {
                "inertia_kg_m2": p.inertia_kg_m2,
                "stderr_kg_m2": p.stderr_kg_m2,
                "commanded_kg_m2": p.commanded_kg_m2,
                "plain_kg_m2": p.plain_kg_m2,
                "viscous_Nm_s_per_rad": p.viscous_Nm_s_per_rad,
                "friction_Nm": p.friction_Nm,
            }
            for p in found.pushes
        ],
    }
