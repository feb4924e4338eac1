"""A plan carried out on a virtual bench: the executor of the real bench, in virtual time."""

from collections.abc import Callable
from typing import Any

import numpy as np

from motord.control.types import SETPOINT
from motord.schema import TICK_DTYPE, TRUTH_DTYPE, Request
from motord.sequencing import Demand, Executor, Plan, TickWatcher
from motord.virtual.bench import VirtualBench

LOOK_S = 0.05
"""Virtual time between two looks of the executor."""

HAND_ON_S = 1.0
"""Virtual time that is handed on at once: large blocks are written and read fastest."""

BlockSink = Callable[[np.ndarray, np.ndarray], None]


class PlanFailed(Exception):
    """A plan that did not end as it should; the message says why."""


def run_plan(bench: VirtualBench, plan: Plan, on_block: BlockSink) -> list[dict[str, Any]]:
    """Run `plan` to its end, handing on blocks (ticks, truth). Returns the points taken.

    Raises PlanFailed if the bench trips or the plan fails.
    """
    executor, watcher = Executor(plan), TickWatcher()
    setpoint = np.zeros(1, SETPOINT)
    setpoint["plan_point"] = -1
    demand = Demand()
    blocks = _Blocks(on_block, bench.config.loop.rate_Hz)
    while not executor.finished:
        seen = watcher.take(blocks.run(bench, setpoint))
        before, demand = demand, executor.advance(seen)
        _put(setpoint, before, demand)
    blocks.hand_on()
    if executor.message:
        raise PlanFailed(f"{plan.name}: {executor.message}")
    return executor.points


class _Blocks:
    """Blocks of HAND_ON_S, filled look by look and handed on when full."""

    def __init__(self, sink: BlockSink, rate_Hz: int) -> None:
        self._sink = sink
        self._look = max(round(LOOK_S * rate_Hz), 1)
        self._size = max(round(HAND_ON_S / LOOK_S), 1) * self._look
        self._start()

    def run(self, bench: VirtualBench, setpoint: np.ndarray) -> np.ndarray:
        """Run the bench for one look and return its ticks."""
        if self._filled == self._size:
            self.hand_on()
        rows = slice(self._filled, self._filled + self._look)
        bench.fill(setpoint, self._ticks[rows], self._truth[rows])
        self._filled += self._look
        return self._ticks[rows]

    def hand_on(self) -> None:
        """Give what there is to the sink."""
        if self._filled:
            self._sink(self._ticks[: self._filled], self._truth[: self._filled])
            self._start()

    def _start(self) -> None:
        self._filled = 0
        self._ticks = np.zeros(self._size, TICK_DTYPE)
        self._truth = np.zeros(self._size, TRUTH_DTYPE)


def _put(setpoint: np.ndarray, before: Demand, demand: Demand) -> None:
    """Write a demand into the set-point record, as the supervisor does into its mailbox."""
    s = setpoint[0]
    s.seq += 1
    s.torque_Nm, s.speed_rad_s = demand.torque_Nm, 2 * np.pi * demand.speed_Hz
    s.brake, s.drive_rad_s = demand.brake, demand.drive_rad_s
    s.plan_point, s.compensate = demand.plan_point, demand.compensate
    induced = demand.induced
    s.induced_gain[:] = np.subtract(induced.gain, 1.0)
    s.induced_offset_A[:] = induced.offset_A
    s.induced_cogging = induced.cogging - 1.0
    if demand.enabled != before.enabled:
        s.request = Request.ENABLE if demand.enabled else Request.DISABLE
        s.request_seq += 1
