"""Profiles as files, and what becomes of them on the simulated rig in virtual time."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motord.config import Config, load
from motord.experiments.plans import build
from motord.sequencing import Plan
from motord.virtual import VirtualBench
from motord.virtual.plan import PlanFailed, run_plan

Rows = Sequence[tuple[float, float, float]]
"""Time (s), torque (Nm), speed (turns/s)."""

SMALL: Rows = ((0, 0, 0), (2, 2, 0.8), (4, 2, 0.8), (6, 0, 0))


def write(path: Path, rows: Rows, header: str = "time_s,torque_Nm,speed_Hz") -> Path:
    path.write_text("\n".join([header, *(",".join(map(repr, row)) for row in rows)]) + "\n")
    return path


def made(path: Path, rows: Rows, config: Config | None = None, **settings: Any) -> Plan:
    given = {"file": str(write(path, rows)), "repeats": 1, **settings}
    return build("profile", config or load(), given)


def changed(**tables: dict[str, Any]) -> Config:
    """Return the simulated bench with some settings changed."""
    content = load().model_dump()
    for table, values in tables.items():
        content[table] |= values
    return Config.model_validate(content)


def played(plan: Plan, config: Config | None = None, seed: int = 1) -> tuple[np.ndarray, str]:
    """Return the ticks of a plan on the simulated rig, and why it failed, "" if it did not."""
    blocks: list[np.ndarray] = []
    try:
        run_plan(VirtualBench(config or load(), seed=seed), plan, lambda *b: blocks.append(b[0]))
    except PlanFailed as failed:
        return np.concatenate(blocks), str(failed)
    return np.concatenate(blocks), ""
