"""Sequencing: plans as generators of demands, carried out by one executor. Pure: no I/O, no clock.

An `Executor` carries out a `Plan`, in virtual time and on the bench alike.
"""

from motord.sequencing.demand import NOTHING_INDUCED, Demand, Induced, OperatingPoint
from motord.sequencing.executor import Executor, PlanState
from motord.sequencing.observation import Observation, TickWatcher
from motord.sequencing.plan import Plan
from motord.sequencing.settings import PlanError

__all__ = [
    "NOTHING_INDUCED",
    "Demand",
    "Executor",
    "Induced",
    "Observation",
    "OperatingPoint",
    "Plan",
    "PlanError",
    "PlanState",
    "TickWatcher",
]
