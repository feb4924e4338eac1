"""The rotor driven from outside, without current, at one speed after the other.

The power stage is off: the bench is READY, after a short ENABLED at zero torque that shows it to be
in order and arms the interlocks. Enabled at zero torque the offsets of the currents would flow.
"""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from motord.config import Config, DrivenConfig
from motord.sequencing.capture import retaken_if_poor
from motord.sequencing.demand import OperatingPoint
from motord.sequencing.driven_point import driven_point, driven_point_s
from motord.sequencing.limits import SPEED_MARGIN, check_drive
from motord.sequencing.motions import Motion, enable, hold, ramp_down, restartable, within
from motord.sequencing.plan import Plan
from motord.sequencing.settings import chosen

STANDSTILL_Hz = 0.05
"""Speed below which the rotor counts as standing."""


def driven_plan(name: str, config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.NAME]` with `settings`. Raises PlanError."""
    driven = chosen(config, name, DrivenConfig, settings)
    for speed_Hz in driven.speeds_Hz:
        check_drive(config, speed_Hz)
    trip_rad_s = SPEED_MARGIN * config.limits.trip_speed_rad_s
    fastest_Hz = min(config.drive.speed_max_rad_s, trip_rad_s) / (2 * math.pi)
    return Plan(
        name=name,
        points=tuple(
            OperatingPoint(index, 0.0, speed_Hz, driven.turns)
            for index, speed_Hz in enumerate(driven.speeds_Hz)
        ),
        motion=partial(driven_points, driven, fastest_Hz),
        point_s=partial(driven_point_s, driven),
        settings=driven.model_dump(mode="json"),
        needs="drive",
        ends_s=3.0,
    )


make_back_emf, make_cogging = (partial(driven_plan, name) for name in ("back-emf", "cogging"))
"""Make the plans of these names from a bench and settings."""


def driven_points(
    driven: DrivenConfig, fastest_Hz: float, points: tuple[OperatingPoint, ...]
) -> Motion[None]:
    """Enable and disable, take every speed, come to rest."""
    yield from enable()
    yield from ramp_down()
    for point in points:
        yield from retaken_if_poor(driven_point, point, driven, fastest_Hz)
    yield from stand_still()


@restartable
def stand_still(timeout_s: float = 30.0) -> Motion[None]:
    """Stop the drive and wait until the rotor stands."""
    demand = (yield None).demand.at_rest(speed_Hz=0.0, label="coming to rest")
    yield from within(
        timeout_s,
        hold(demand, lambda seen: abs(seen.speed_Hz) < STANDSTILL_Hz),
        lambda _: "the rotor still turns: the drive did not stop",
    )
