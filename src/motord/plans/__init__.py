"""Experiments as plans: generators of steps, carried out by one executor. Pure: no I/O, no clock.

`build(name, config, settings)` makes a plan; `Executor` walks through it, in virtual time and on
the bench alike.
"""

from motord.plans.build import PLANS, build
from motord.plans.executor import Executor
from motord.plans.observation import Observation, TickWatcher
from motord.plans.settings import PlanError
from motord.plans.steps import Demand, OperatingPoint, Plan

__all__ = [
    "PLANS",
    "Demand",
    "Executor",
    "Observation",
    "OperatingPoint",
    "Plan",
    "PlanError",
    "TickWatcher",
    "build",
]
