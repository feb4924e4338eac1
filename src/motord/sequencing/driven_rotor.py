"""The rotor driven from outside, without current, at one speed after the other.

The power stage is off: the bench is READY, after a short ENABLED at zero torque that shows it to be
in order and arms the interlocks. Enabled at zero torque the offsets of the currents would flow.
"""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from motord.config import Config, DrivenConfig
from motord.schema import State
from motord.sequencing.capture import account, capture, retaken_if_poor
from motord.sequencing.demand import Demand, OperatingPoint
from motord.sequencing.limits import SPEED_MARGIN, check_drive
from motord.sequencing.motions import (
    Capture,
    Motion,
    enable,
    guarded,
    hold,
    near_speed,
    ramp_down,
    restartable,
    within,
)
from motord.sequencing.observation import Observation
from motord.sequencing.plan import Plan
from motord.sequencing.quality import quality_at_speed
from motord.sequencing.settings import chosen

APPROACH_S = 3.0
"""How long a drive is expected to take to a speed, for the estimate."""

STANDSTILL_Hz = 0.05
"""Speed below which the rotor counts as standing."""

STOP_S = 30.0
"""Time in which it comes to rest, or as much as it has to settle at a speed."""


def driven_point_s(driven: DrivenConfig, point: OperatingPoint) -> float:
    """Return an estimate of the time that `driven_point` takes (s)."""
    return APPROACH_S + driven.settle_s + (point.turns + 1) / point.speed_Hz


@restartable
def driven_point(point: OperatingPoint, driven: DrivenConfig, fastest_Hz: float) -> Motion[Capture]:
    """Drive the rotor until its mean speed is steady, then capture `point.turns` turns.

    It comes from a higher speed, at most `fastest_Hz`.
    """
    from_Hz = min(driven.spin_up * point.speed_Hz, fastest_Hz)
    seen = yield from guarded(_steady_turns(point, driven, from_Hz), _stopped)
    return account(point, seen, quality_at_speed(seen, point.speed_Hz, driven), driven=True)


def _stopped(seen: Observation) -> str:
    return f"{seen.demand.label}: the bench was stopped" if seen.state is State.OFF else ""


def _steady_turns(
    point: OperatingPoint, driven: DrivenConfig, from_Hz: float
) -> Motion[Observation]:
    began = yield None
    demand = Demand(
        speed_Hz=point.speed_Hz,
        drive_rad_s=2 * math.pi * point.speed_Hz,
        label=f"driven at {point.speed_Hz:g} Hz",
    )
    if from_Hz > point.speed_Hz:
        yield from _spin_up(
            demand.labelled("coming from above", drive_rad_s=2 * math.pi * from_Hz),
            0.5 * (point.speed_Hz + from_Hz),
            driven.settle_timeout_s / 3,
        )
    while True:
        reaches = near_speed(point.speed_Hz, driven.speed_tolerance, since=(yield None))
        reached = yield from within(
            driven.settle_timeout_s,
            hold(demand.labelled("waiting for the speed"), reaches),
            lambda seen: f"{demand.label}: {_why_not_reached(seen, driven)}",
            since=began,
        )
        if (yield from _is_steady(demand.labelled("settling"), reached, driven)):
            return (yield from capture(point, demand.labelled("capturing")))


def _spin_up(demand: Demand, above_Hz: float, limit_s: float) -> Motion[None]:
    """Go faster than the point; a belt that slips may not get all the way there."""
    began = seen = yield None
    while seen.turn_speed_Hz <= above_Hz and seen.since_s(began) <= limit_s:
        seen = yield demand


def _is_steady(demand: Demand, reached: Observation, driven: DrivenConfig) -> Motion[bool]:
    """Return whether the mean speed stayed where it was `reached`, for the settling time."""
    while True:
        seen = yield demand
        moved = abs(seen.turn_speed_Hz - reached.turn_speed_Hz) / demand.speed_Hz
        if moved > driven.settle_tolerance:
            return False
        if seen.since_s(reached) >= driven.settle_s:
            return True


def _why_not_reached(seen: Observation, driven: DrivenConfig) -> str:
    speed_Hz, wanted_Hz = seen.turn_speed_Hz, seen.demand.speed_Hz
    if abs(speed_Hz) < 0.1 * wanted_Hz:
        hint = "does the drive answer, is the belt on?"
    elif speed_Hz < 0:
        hint = "it turns the other way: reverse the drive, or [motor] encoder_direction"
    elif abs(speed_Hz / wanted_Hz - 1.0) < driven.speed_tolerance:
        hint = "it does not hold still: does the belt slip?"
    else:
        hint = "does the belt slip, is the drive's scale right?"
    return f"the rotor turned at {speed_Hz:.3g} Hz after {driven.settle_timeout_s:g} s; {hint}"


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
    yield from stand_still(max(STOP_S, driven.settle_timeout_s))


@restartable
def stand_still(timeout_s: float) -> Motion[None]:
    """Stop the drive and wait until the rotor stands."""
    demand = (yield None).demand.at_rest(speed_Hz=0.0, label="coming to rest")
    yield from within(
        timeout_s,
        hold(demand, lambda seen: abs(seen.speed_Hz) < STANDSTILL_Hz),
        lambda _: "the rotor still turns: the drive did not stop",
    )
