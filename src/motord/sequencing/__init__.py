"""Sequencing: plans as generators of steps, carried out by one executor. Pure: no I/O, no clock.

An `Executor` walks through a `Plan`, in virtual time and on the bench alike.
"""

from motord.sequencing.executor import Executor
from motord.sequencing.observation import Observation, TickWatcher
from motord.sequencing.settings import PlanError
from motord.sequencing.steps import Demand, OperatingPoint, Plan

__all__ = [
    "Demand",
    "Executor",
    "Observation",
    "OperatingPoint",
    "Plan",
    "PlanError",
    "TickWatcher",
]
