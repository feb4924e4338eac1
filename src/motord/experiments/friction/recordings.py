"""Coast-downs and the inertia, from recordings, settings and the result of `analyse inertia`."""

import json
from collections.abc import Iterator, Sequence
from math import isfinite, pi, sqrt
from pathlib import Path

import numpy as np

from motord.config import MotorConfig, MotorFile, load, read_toml
from motord.experiments.friction.coast_down import CoastDown
from motord.experiments.friction.result import Inertia
from motord.experiments.friction.settings import FrictionConfig
from motord.experiments.subject import AnalysisError, recorded_settings
from motord.identification.operating_points import good_points
from motord.recording.reader import Run, bounds_of

NAME = "friction"

COLUMNS = ("t_ns", "encoder_count", "torque_set_Nm", "plan_point")


def settings_of(runs: Sequence[Run], config: Path | None) -> FrictionConfig:
    """Return `[plans.friction]` of a bench file, else the settings that the plan ran with.

    Raises AnalysisError, ConfigError.
    """
    for run in runs:
        name = str(run.metadata.get("plan", {}).get("name", ""))
        if name != NAME:
            said = f"is of the plan {name}" if name else "names no plan"
            raise AnalysisError(f"{run.path}: {said}; needed: {NAME}")
    if config and not set(read_toml(config)[1]) <= set(MotorFile.model_fields):
        return load(config).plans.of(NAME, FrictionConfig)
    return recorded_settings(runs[0], FrictionConfig)


def inertia_of(file: Path | None, settings: FrictionConfig) -> Inertia:
    """Return the inertia of a file that `analyse inertia` wrote, else of the settings.

    Raises AnalysisError, OSError.
    """
    if file is not None:
        return _read_inertia(file)
    if not settings.inertia_kg_m2:
        raise AnalysisError(
            "friction follows from the moment of inertia, which is not known: name the result of "
            "`motord analyse inertia -o FILE` with --inertia FILE, or set inertia_kg_m2 in "
            "[plans.friction] and name the bench file with -c"
        )
    uncertainty = settings.inertia_tolerance / sqrt(3)
    return Inertia(settings.inertia_kg_m2, uncertainty, "[plans.friction]")


def _read_inertia(file: Path) -> Inertia:
    try:
        found = json.loads(file.read_text())
        if found["schema"] != "motord.inertia/1":
            raise ValueError(found["schema"])
        value, uncertainty = float(found["inertia_kg_m2"]), float(found["uncertainty_kg_m2"])
        if not (isfinite(value) and value > 0 and isfinite(uncertainty) and uncertainty >= 0):
            raise ValueError(value)
    except (ValueError, KeyError, TypeError):
        raise AnalysisError(f"{file}: is no result of `motord analyse inertia -o FILE`") from None
    return Inertia(value, uncertainty / value, file.name)


def coast_downs(runs: Sequence[Run], motor: MotorConfig) -> Iterator[CoastDown]:
    """Yield the coast-downs of good quality. Raises AnalysisError, IdentifyError."""
    for run in runs:
        missing = [name for name in COLUMNS if name not in run.columns]
        if missing:
            raise AnalysisError(f"{run.path}: the recording has no {', '.join(missing)}")
        for point in good_points(run.operating_points()):
            ticks = run.ticks(COLUMNS, **bounds_of(point))
            ticks = ticks[ticks["plan_point"] == int(point["index"])]
            if np.any(ticks["torque_set_Nm"] != 0.0):
                raise AnalysisError(
                    f"{run.path}: coast-down {int(point['index']) + 1}: a torque was commanded"
                )
            turn_rad = motor.encoder_direction * 2 * pi / motor.counts
            angle_rad = ticks["encoder_count"].astype(float) * turn_rad
            name, index = run.path.name, int(point["index"])
            yield CoastDown.of(name, index, ticks["t_ns"], angle_rad, motor.counts)
