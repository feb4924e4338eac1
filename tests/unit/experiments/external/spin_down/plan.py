"""The plan: one point, captured from the end of the torque until standstill."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from spin_down import SpinDownConfig

from motord.config import Config
from motord.sequencing import Demand, OperatingPoint, Plan
from motord.sequencing.capture import account, take_points
from motord.sequencing.limits import check_torque
from motord.sequencing.motions import Capture, Motion, hold, restartable, wait, within
from motord.sequencing.quality import quality
from motord.sequencing.settings import chosen


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.spin-down]` with `settings`. Raises PlanError."""
    own = chosen(config, "spin-down", SpinDownConfig, settings)
    check_torque(config, own.torque_Nm)
    return Plan(
        name="spin-down",
        points=(OperatingPoint(0, own.torque_Nm, 0.0, 0, aim="a spin-down"),),
        motion=partial(take_points, partial(spin_down, own=own)),
        point_s=spin_down_s,
        settings=own.model_dump(mode="json"),
        needs="",
    )


def spin_down_s(_: OperatingPoint) -> float:
    """Return an estimate of the time that a point takes (s); no lambda: plans are pickled."""
    return 10.0


@restartable
def spin_down(point: OperatingPoint, own: SpinDownConfig) -> Motion[Capture]:
    """Accelerate for some time, let go, capture until the rotor stands still."""
    free = Demand(enabled=True, label="spin-down")
    accelerate = free.labelled("accelerating", torque_Nm=own.torque_Nm)
    yield from wait(accelerate, own.accelerate_s)
    yield from hold(free.labelled("letting go"), lambda seen: seen.torque_set_Nm == 0.0)
    coast = hold(
        replace(free.labelled("coasting"), plan_point=point.index),
        lambda seen: seen.highest_rad - seen.lowest_rad < 0.01,
    )
    seen = yield from within(60.0, coast, lambda seen: "the rotor does not stop")
    return account(point, seen, quality(seen, None))
