"""A plan carried out on a virtual bench: the executor of the real bench, in virtual time."""

from collections.abc import Callable
from typing import Any

import numpy as np

from motord.control.types import SETPOINT
from motord.plans import Demand, Executor, Plan, TickWatcher
from motord.schema import Request, State
from motord.virtual import VirtualBench

LOOK_S = 0.02
"""Virtual time between two looks of the executor, as the supervisor's on a real bench."""

BlockSink = Callable[[np.ndarray, np.ndarray], None]
PointSink = Callable[[dict[str, Any]], None]
ProgressSink = Callable[[dict[str, Any]], None]


class PlanFailed(Exception):
    """A plan that did not end as it should; the message says why."""


def run_plan(
    bench: VirtualBench,
    plan: Plan,
    on_block: BlockSink,
    on_point: PointSink = lambda point: None,
    on_progress: ProgressSink = lambda progress: None,
) -> list[dict[str, Any]]:
    """Run `plan` to its end, handing on each block (ticks, truth). Returns the points taken.

    Raises PlanFailed if the bench trips or the plan fails.
    """
    executor, watcher = Executor(plan), TickWatcher()
    setpoint = np.zeros(1, SETPOINT)
    setpoint["plan_point"] = -1
    ticks_a_look = max(round(LOOK_S * bench.config.loop.rate_Hz), 1)
    demand, handed_on = Demand(), 0
    while not executor.finished:
        ticks, truth = bench.run(setpoint, ticks_a_look)
        on_block(ticks, truth)
        seen = watcher.take(ticks)
        before, demand = demand, executor.advance(seen)
        _put(setpoint, before, demand, seen.state)
        for point in executor.points[handed_on:]:
            on_point(point)
        if len(executor.points) > handed_on:
            on_progress(executor.progress())
        handed_on = len(executor.points)
    if executor.message:
        raise PlanFailed(f"{plan.name}: {executor.message}")
    return executor.points


def _put(setpoint: np.ndarray, before: Demand, demand: Demand, state: State) -> None:
    """Write a demand into the set-point record, as the supervisor does into its mailbox."""
    s = setpoint[0]
    s.seq += 1
    s.torque_Nm, s.speed_rad_s = demand.torque_Nm, 2 * np.pi * demand.speed_Hz
    s.brake, s.drive_rad_s = demand.brake, demand.drive_rad_s
    s.plan_point, s.compensate = demand.plan_point, demand.compensate
    if demand.enabled != before.enabled:
        s.request = Request.ENABLE if demand.enabled else Request.DISABLE
        s.request_seq += 1
