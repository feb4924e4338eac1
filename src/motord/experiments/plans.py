"""From a plan's name and settings to a plan that was checked against the bench's limits."""

from collections.abc import Mapping
from typing import Any

from motord.config import Config
from motord.config.experiments import broken_experiments, plan_kinds
from motord.section.complaints import suggestion
from motord.sequencing import Plan, PlanError
from motord.sequencing.limits import check_torque_changes


def build(name: str, config: Config, settings: Mapping[str, Any] | None = None) -> Plan:
    """Return plan `name` with `settings` over the bench's own. Raises PlanError."""
    kinds = plan_kinds()
    if name not in kinds:
        known = f"no plan '{name}'; there are: {', '.join(kinds)}{suggestion(name, kinds)}"
        raise PlanError("; ".join([known, *broken_experiments()]))
    plan: Plan = kinds[name].maker()(config, settings or {})
    try:
        check_torque_changes(config, (0.0, *(point.torque_Nm for point in plan.points)))
    except PlanError as error:
        raise PlanError(f"{name}: {error}") from error
    return plan
