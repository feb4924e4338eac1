"""A plan tried out in virtual time before it is run: which points would fail, and why."""

import time
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from motord.calibration import Calibration
from motord.config import Config
from motord.sequencing import OperatingPoint, Plan
from motord.sequencing.quality import GOOD
from motord.virtual.bench import VirtualBench
from motord.virtual.nominal_rig import nominal_rig
from motord.virtual.plan import PlanFailed, run_plan


@dataclass(frozen=True)
class Forecast:
    """What became of a point in the simulation.

    trouble: why it would fail, "" if it would not; quality: of its last take; simulated: False if
    there was no time for it, or if it cannot be, for the reason that trouble then states.
    """

    point: OperatingPoint
    trouble: str = ""
    quality: str = GOOD
    simulated: bool = True

    @property
    def fine(self) -> bool:
        """True if the point was simulated, did not fail and would be good."""
        return self.simulated and not self.trouble and self.quality == GOOD


BY_HAND = frozenset({"inertia-oscillation"})
"""Plans in which an operator has to move the rotor, unless the rig simulates that."""


class _TooLongError(Exception):
    """There is no time left."""


def forecasts(
    config: Config,
    plan: Plan,
    calibration: Calibration | None,
    pool: Executor,
    limit_s: float,
) -> Iterator[Forecast]:
    """Yield what becomes of each point of `plan` on the rig `nominal_rig`, in order.

    Each point is taken on a rig of its own, from standstill, so nothing is said of the moves
    between points. After `limit_s` of elapsed time those that are left are not simulated.
    """
    if plan.name in BY_HAND and nominal_rig(config)[1].swing is None:
        why = "somebody has to move the rotor by hand"
        yield from (Forecast(point, trouble=why, simulated=False) for point in plan.points)
        return
    deadline_s = time.monotonic() + limit_s
    tries = [
        pool.submit(_try, config, plan.part((point,)), calibration, deadline_s)
        for point in plan.points
    ]
    for each in tries:
        yield each.result()


def _try(
    config: Config, part: Plan, calibration: Calibration | None, deadline_s: float
) -> Forecast:
    def keep_time(_ticks: np.ndarray, _truth: np.ndarray) -> None:
        if time.monotonic() > deadline_s:
            raise _TooLongError

    [point] = part.points
    nominal, truth = nominal_rig(config)
    try:
        keep_time(np.empty(0), np.empty(0))
        bench = VirtualBench(nominal, truth, calibration=calibration)
        takes = run_plan(bench, part, keep_time)
    except PlanFailed as failed:
        return Forecast(point, trouble=str(failed).removeprefix(f"{part.name}: "))
    except _TooLongError:
        return Forecast(point, simulated=False)
    return Forecast(point, quality=str(takes[-1].get("quality", GOOD)))
