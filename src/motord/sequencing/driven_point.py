"""One speed of the rotor that is driven from outside."""

import math

from motord.config import DrivenConfig
from motord.schema import State
from motord.sequencing.capture import account, capture
from motord.sequencing.demand import Demand, OperatingPoint
from motord.sequencing.motions import (
    Capture,
    Motion,
    guarded,
    hold,
    near_speed,
    restartable,
    within,
)
from motord.sequencing.observation import Observation
from motord.sequencing.quality import quality_at_speed

APPROACH_S = 3.0
"""How long a drive is expected to take to a speed, for the estimate."""


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
