"""`friction`: the rotor accelerated by the motor, then left to coast down without current."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import copysign
from typing import Any

from motord.config import BrakeConfig, Config, LimitsConfig
from motord.experiments.free_rotor import SLOW_RISE_S, runaway
from motord.experiments.friction import NAME, FrictionConfig
from motord.sequencing import Demand, Observation, OperatingPoint, Plan, PlanError
from motord.sequencing.brake_servo import release_s
from motord.sequencing.capture import account, take_points
from motord.sequencing.limits import check_speed, check_torque
from motord.sequencing.motions import Capture, Motion, guarded, hold, restartable, wait, within
from motord.sequencing.quality import quality
from motord.sequencing.settings import chosen

LEAST_TORQUE_PART = 0.3
"""Part of the torque that is left near the start speed, so as not to go far beyond it."""

TORQUE_SPREAD = 0.2
"""Part by which the torque differs between repeats, so that they begin at different angles: the
encoder's rounding is not to repeat.
"""

GOLDEN_RATIO = (5**0.5 - 1) / 2

CURRENT_DECAY_S = 0.02
"""Time after the end of the torque in which its current has gone."""

LEAST_TURNS = 1.0
"""Turns below which a coast-down is poor: the cogging torque is not averaged."""

OVERSHOOT = 1.25
"""Speed, in parts of the start speed, that the rotor may reach while the torque ramps down."""

ASSUMED_COAST_S = 4.0
"""Time of a coast-down and the acceleration before it, for the estimate of time."""


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.friction]` with `settings`. Raises PlanError."""
    given = dict(settings)
    if given.pop("compensate", "off") != "off":
        raise PlanError(
            f"{NAME}: compensation makes currents, and a coast-down is without: compensate is "
            "always 'off'"
        )
    own = chosen(config, NAME, FrictionConfig, given)
    check_torque(config, own.torque_Nm)
    check_speed(config, OVERSHOOT * own.start_speed_Hz)
    return Plan(
        name=NAME,
        points=tuple(_point(index, own) for index in range(2 * own.repeats)),
        motion=partial(
            take_points, partial(coast_down, own=own, brake=config.brake, limits=config.limits)
        ),
        point_s=coast_down_s,
        settings={**own.model_dump(mode="json"), "compensate": "off"},
        needs="",
    )


def _point(index: int, own: FrictionConfig) -> OperatingPoint:
    sign, repeat = (-1) ** index, index // 2
    less = TORQUE_SPREAD * (repeat * GOLDEN_RATIO % 1.0)
    direction = "forwards" if sign > 0 else "backwards"
    return OperatingPoint(
        index,
        sign * own.torque_Nm * (1.0 - less),
        sign * own.start_speed_Hz,
        0,
        aim=f"a coast-down {direction} from {own.start_speed_Hz:g} to {own.stop_speed_Hz:g} Hz",
    )


def coast_down_s(_: OperatingPoint) -> float:
    """Return an estimate of the time that `coast_down` takes (s)."""
    return ASSUMED_COAST_S


@restartable
def coast_down(
    point: OperatingPoint, own: FrictionConfig, brake: BrakeConfig, limits: LimitsConfig
) -> Motion[Capture]:
    """Accelerate to the start speed, end the torque, capture until the stop speed."""
    began = yield None
    sign = copysign(1.0, point.torque_Nm)
    free = began.demand.at_rest(
        enabled=True,
        brake=0.0,
        label=f"coast-down {point.index + 1}, {'forwards' if sign > 0 else 'backwards'}",
    )
    if began.demand.brake:
        yield from wait(free.labelled("releasing the brake"), release_s(brake))
    accelerate = guarded(
        _accelerate(free.labelled("accelerating"), point), runaway(limits, point.torque_Nm)
    )
    yield from within(SLOW_RISE_S + own.timeout_s, accelerate, lambda seen: _too_slow(seen, own))
    ending = free.labelled("ending the torque")
    off = hold(ending, lambda seen: seen.torque_set_Nm == 0.0)
    yield from within(own.timeout_s, off, lambda seen: f"{seen.demand.label}: it does not end")
    yield from wait(ending, CURRENT_DECAY_S)
    coast = hold(
        replace(free.labelled("coasting"), plan_point=point.index),
        lambda seen: seen.plan_point == point.index and sign * seen.speed_Hz < own.stop_speed_Hz,
    )
    seen = yield from within(own.timeout_s, coast, lambda seen: _too_fast(seen, own))
    turns = round(abs(seen.point_turns), 3)
    fault = f"coasted for {turns:.2g} turns only" if turns < LEAST_TURNS else ""
    return account(point, seen, quality(seen, own.temperature_C, fault), turns=turns)


def _accelerate(demand: Demand, point: OperatingPoint) -> Motion[None]:
    """Accelerate, with a torque that rises slowly, and falls with the speed that is missing."""
    began = seen = yield None
    while (part := seen.speed_Hz / point.speed_Hz) < 1.0:
        risen = seen.since_s(began) / SLOW_RISE_S
        torque_Nm = point.torque_Nm * min(risen, max(1.0 - part, LEAST_TORQUE_PART), 1.0)
        seen = yield replace(demand, torque_Nm=torque_Nm)


def _too_slow(seen: Observation, own: FrictionConfig) -> str:
    return (
        f"{seen.demand.label}: {own.start_speed_Hz:g} Hz not reached within {own.timeout_s:g} s "
        f"after the torque rose; is the rotor free, and {100 * LEAST_TORQUE_PART:g} % of torque_Nm "
        "more than friction?"
    )


def _too_fast(seen: Observation, own: FrictionConfig) -> str:
    return (
        f"{seen.demand.label}: still above {own.stop_speed_Hz:g} Hz after {own.timeout_s:g} s; "
        "raise timeout_s or stop_speed_Hz"
    )
