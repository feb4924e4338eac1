"""From a plan's name and settings to a plan that was checked against the bench's limits."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from pydantic import ValidationError

from motord.config import Config, MeshConfig
from motord.plans import mesh
from motord.plans.brake_servo import brake_torque_Nm
from motord.plans.steps import Plan
from motord.schema import Compensate


class PlanError(Exception):
    """A plan that cannot be run; the message says which setting and why."""


@dataclass(frozen=True)
class Kind:
    """A plan that can be started: what it is for and what makes it."""

    summary: str
    make: Callable[[Config, Mapping[str, Any]], Plan]


def build(name: str, config: Config, settings: Mapping[str, Any] | None = None) -> Plan:
    """Return plan `name` with `settings` over the bench's own. Raises PlanError."""
    if name not in PLANS:
        raise PlanError(f"no plan '{name}'; there are: {', '.join(PLANS)}")
    return PLANS[name].make(config, settings or {})


def _mesh_plan(name: str, config: Config, settings: Mapping[str, Any]) -> Plan:
    own: MeshConfig = getattr(config.plans, name)
    given = dict(settings)
    word = given.pop("compensate", "off" if name == "calibrate" else "on")
    compensate = _compensate(word)
    try:
        chosen = MeshConfig.model_validate({**own.model_dump(), **given})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        known = ", ".join([*MeshConfig.model_fields, "compensate"])
        raise PlanError(f"{name}: setting {key}: {first['msg']}; settings are: {known}") from None
    check_limits(config, chosen)
    return Plan(
        name=name,
        points=mesh.points(chosen),
        make_steps=partial(mesh.steps, chosen, config.brake, int(compensate)),
        estimate_s=partial(mesh.seconds, chosen, config.brake),
        settings={**chosen.model_dump(mode="json"), "compensate": word},
    )


def _compensate(word: object) -> Compensate:
    words = {
        "off": Compensate(0),
        "on": Compensate.CURRENTS | Compensate.COGGING,
        "currents": Compensate.CURRENTS,
        "cogging": Compensate.COGGING,
    }
    if word not in words:
        raise PlanError(f"compensate = {word!r}: one of {', '.join(words)}")
    return words[str(word)]


def check_limits(config: Config, chosen: MeshConfig) -> None:
    """Refuse a mesh beyond the bench's limits, before anything moves. Raises PlanError."""
    limits = config.limits
    for torque_Nm in chosen.torques_Nm:
        if torque_Nm > limits.torque_Nm:
            raise PlanError(f"{torque_Nm:g} Nm is above [limits] torque_Nm = {limits.torque_Nm:g}")
    for speed_Hz in chosen.speeds_Hz:
        speed_rad_s = 2 * math.pi * speed_Hz
        if speed_rad_s > 0.8 * limits.trip_speed_rad_s:
            raise PlanError(
                f"{speed_Hz:g} Hz is within 20 % of the over-speed trip, [limits] "
                f"trip_speed_rad_s = {limits.trip_speed_rad_s:g} ({speed_rad_s:.3g} rad/s asked)"
            )
        most_Nm = brake_torque_Nm(config.brake, 1.0, speed_rad_s)
        if max(chosen.torques_Nm) > most_Nm:
            raise PlanError(
                f"the brake holds at most {most_Nm:.3g} Nm at {speed_Hz:g} Hz "
                f"([brake] torque_max_Nm, critical_speed_rad_s); {max(chosen.torques_Nm):g} asked"
            )


PLANS: dict[str, Kind] = {
    "calibrate": Kind(
        "torque/speed mesh without compensation, for alpha, beta and cogging",
        partial(_mesh_plan, "calibrate"),
    ),
    "verify": Kind(
        "the same mesh with the installed calibration applied, for the remaining ripple",
        partial(_mesh_plan, "verify"),
    ),
}
