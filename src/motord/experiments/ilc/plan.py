"""`learn`: one pass over a mesh with everything applied, to learn the residual torque ripple."""

from collections.abc import Mapping
from typing import Any

from motord.config import Config
from motord.config.plans import LearnConfig
from motord.learned import MAX_NODES
from motord.sequencing import Plan, PlanError
from motord.sequencing.mesh import mesh_plan


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return a pass over the mesh of `[plans.learn]` with `settings`. Raises PlanError."""
    if settings.get("compensate", "on") != "on":
        raise PlanError("learn: it refines all that is applied, so compensate is always on")
    plan = mesh_plan("learn", LearnConfig, config, settings, "on")
    for name in ("torques_Nm", "speeds_Hz"):
        values = plan.settings[name]
        if len(values) > MAX_NODES:
            raise PlanError(f"learn: {len(values)} {name}, at most {MAX_NODES}")
        if len(set(values)) < len(values):
            raise PlanError(f"learn: {name} names a value twice")
    return plan
