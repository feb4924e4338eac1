"""`back-emf`: the rotor driven from outside without current."""

from collections.abc import Mapping
from typing import Any

from motord.config import Config
from motord.sequencing import Plan
from motord.sequencing.driven_rotor import driven_plan


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.back-emf]` with `settings`. Raises PlanError."""
    return driven_plan("back-emf", config, settings)
