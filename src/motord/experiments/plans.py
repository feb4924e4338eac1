"""From a plan's name and settings to a plan that was checked against the bench's limits."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from motord.config import Config
from motord.config.experiments import broken_experiments, plan_kinds
from motord.identification.least_loss import currents_per_Nm
from motord.section.complaints import suggestion
from motord.sequencing import Plan, PlanError
from motord.sequencing.limits import check_torque_changes, i2t_heat_s

SENSED_PART = 0.95
"""Sensed currents, in parts of the nominal ones: by gains of sensors and of a calibration."""


def build(name: str, config: Config, settings: Mapping[str, Any] | None = None) -> Plan:
    """Return plan `name` with `settings` over the bench's own. Raises PlanError."""
    kinds = plan_kinds()
    if name not in kinds:
        known = f"no plan '{name}'; there are: {', '.join(kinds)}{suggestion(name, kinds)}"
        raise PlanError("; ".join([known, *broken_experiments()]))
    plan: Plan = kinds[name].maker()(config, settings or {})
    try:
        check_torque_changes(config, (0.0, *(point.torque_Nm for point in plan.points)))
        _check_i2t(config, plan)
    except PlanError as error:
        raise PlanError(f"{name}: {error}") from error
    return plan


def _check_i2t(config: Config, plan: Plan) -> None:
    """Refuse torques that are held until I2t trips for certain. Raises PlanError.

    By the mean square of each phase's current over a turn, at `SENSED_PART`, while a point settles
    and is captured; all other time is taken to be without current. A plan that may end early is not
    judged, nor repetitions that wait until the bench is cool: the plan that they repeat was.
    """
    if plan.targets or plan.settings.get("cool_below_C"):
        return
    limits = config.limits
    per_Nm2 = (currents_per_Nm(config.motor) ** 2).mean(axis=0)
    settle_s, added_s = plan.settings.get("settle_s") or 0.0, []
    least_A = limits.i2t_current_A / SENSED_PART
    for point in plan.points:
        torque_Nm = point.torque_Nm * min(point.induced.torque_part, 1.0)
        turning = point.turns > 0 and point.speed_Hz != 0.0
        held_s = settle_s + point.turns / abs(point.speed_Hz) if turning else 0.0
        cooling_s = max(plan.point_s(point) - held_s, 0.0)
        heating_s = (per_Nm2 * torque_Nm**2 / least_A**2 - 1.0) * held_s
        added_s += [np.full(3, -cooling_s), heating_s]
    over = i2t_heat_s(np.reshape(added_s, (-1, 3)), np.zeros(3)).max(axis=1) > limits.i2t_time_s
    if not over.any():
        return
    point = plan.points[int(np.argmax(over)) // 2]
    rms_A = abs(point.torque_Nm) * min(point.induced.torque_part, 1.0) * np.sqrt(per_Nm2.max())
    raise PlanError(
        f"{point.torque_Nm:g} Nm at {point.speed_Hz:g} Hz would trip the bench by I2T: {rms_A:.3g} "
        f"A RMS in a phase, [limits] i2t_current_A = {limits.i2t_current_A:g}, i2t_time_s = "
        f"{limits.i2t_time_s:g}; lower the torque, or take fewer turns"
    )
