"""Benches with a simulated rig that departs from the packaged one: its file is written."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from motord.config import BackEmfHarmonic, Config, load
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth


def departing(folder: Path, tables: Mapping[str, Mapping[str, Any]]) -> Config:
    """Return the packaged bench with a rig whose tables are changed.

    The connection of the windings and the back-EMF are the bench's, too.
    """
    config, content = load(), load_truth().model_dump(exclude_none=True)
    for name, table in tables.items():
        content[name] |= table
    motor = RigTruth.model_validate(content).motor
    path = folder / "departing.rig.toml"
    path.write_text("".join(_table(name, table) for name, table in content.items()))
    known = {
        "connection": motor.connection,
        "back_emf": tuple(BackEmfHarmonic(**h.model_dump()) for h in motor.back_emf),
    }
    return config.model_copy(
        update={
            "motor": config.motor.model_copy(update=known),
            "bench": config.bench.model_copy(update={"rig": path}),
        }
    )


def _table(name: str, table: Mapping[str, Any]) -> str:
    return f"[{name}]\n" + "".join(f"{key} = {_value(value)}\n" for key, value in table.items())


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_value(each)}" for key, each in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(each) for each in value) + "]"
    return json.dumps(value)
