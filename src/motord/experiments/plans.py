"""From a plan's name and settings to a plan that was checked against the bench's limits."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from motord.config import Config
from motord.experiments.alignment import plan as align
from motord.experiments.ilc import plan as learn
from motord.experiments.inertia import plan_acceleration as inertia_acceleration
from motord.experiments.inertia import plan_oscillation as inertia_oscillation
from motord.experiments.sensitivity import plan as sensitivity
from motord.sequencing import driven_rotor as driven
from motord.sequencing import mesh
from motord.sequencing.settings import PlanError
from motord.sequencing.steps import Plan


@dataclass(frozen=True)
class PlanKind:
    """A plan that can be started: what it is for and what makes it."""

    summary: str
    make: Callable[[Config, Mapping[str, Any]], Plan]


PLANS: dict[str, PlanKind] = {
    "align": PlanKind(
        "a current vector turned by hand, for phase order, encoder direction and encoder zero",
        align.make,
    ),
    "calibrate": PlanKind(
        "torque/speed mesh without compensation, for alpha, beta and cogging",
        partial(mesh.make, "calibrate"),
    ),
    "verify": PlanKind(
        "the same mesh with the installed calibration applied, for the remaining ripple",
        partial(mesh.make, "verify"),
    ),
    "cogging": PlanKind(
        "rotor driven from outside without current, for the cogging torque",
        partial(driven.make, "cogging"),
    ),
    "back-emf": PlanKind(
        "rotor driven from outside without current, for the back-EMF of the phases",
        partial(driven.make, "back-emf"),
    ),
    "inertia-oscillation": PlanKind(
        "a bar between springs, deflected by hand and let go, for the moment of inertia",
        inertia_oscillation.make,
    ),
    "inertia-acceleration": PlanKind(
        "steps of torque from rest without the brake, for the moment of inertia",
        inertia_acceleration.make,
    ),
    "sensitivity": PlanKind(
        "known errors of gains, offsets and cogging torque, for what each costs in ripple",
        sensitivity.make,
    ),
    "learn": PlanKind(
        "the mesh with all that is known applied, once, to learn what is left at each point",
        learn.make,
    ),
}
"""Name of a plan to what makes it; each plan is a module of this package."""


def build(name: str, config: Config, settings: Mapping[str, Any] | None = None) -> Plan:
    """Return plan `name` with `settings` over the bench's own. Raises PlanError."""
    if name not in PLANS:
        raise PlanError(f"no plan '{name}'; there are: {', '.join(PLANS)}")
    return PLANS[name].make(config, settings or {})
