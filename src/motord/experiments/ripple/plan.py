"""`verify`: the mesh with the installed calibration applied."""

from collections.abc import Mapping
from typing import Any

from motord.config import Config, MeshConfig
from motord.sequencing import Plan
from motord.sequencing.mesh import mesh_plan


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan over the mesh of `[plans.verify]` with `settings`. Raises PlanError."""
    return mesh_plan("verify", MeshConfig, config, settings, "on")
