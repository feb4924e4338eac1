"""`profile`: torque and speed over time, as a file has them, one point a cycle.

The motor makes the torque, the brake's feed-forward holds the speed, and its servo corrects the
configured curve slowly. A cycle begins at standstill, and again from its beginning after a pause.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import exp, log
from typing import Any

import numpy as np

from motord.config import BrakeConfig, Config
from motord.experiments.profile import NAME, ProfileConfig
from motord.experiments.profile.checks import check, check_room
from motord.experiments.profile.course import Course
from motord.experiments.profile.trace import read
from motord.sequencing import Demand, Observation, OperatingPoint, Plan
from motord.sequencing.brake_servo import BrakeServo
from motord.sequencing.capture import account, take_points
from motord.sequencing.driven_rotor import STANDSTILL_Hz
from motord.sequencing.motions import (
    Capture,
    Motion,
    MotionFailed,
    brake_to_rest,
    restartable,
    within,
)
from motord.sequencing.quality import quality
from motord.sequencing.settings import chosen, compensation

SERVO_FROM_Hz = 0.2
"""Speed from which on the servo corrects the brake."""

SERVO_BAND = 0.25
"""Speed error, in parts, beyond which it does not: the rotor follows something else then."""

SERVO_SHIFT_MAX = 2.0
"""Largest factor by which it departs from the configured curve."""

ASTRAY_S = 3.0
"""How long the speed may be further off than speed_error_max_Hz."""

REST_TIMEOUT_S = 30.0
REST_S = 1.0
"""Time to come to rest before a cycle, for the estimate."""

SHIFT_LIMIT = 2 * log(SERVO_SHIFT_MAX)


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.profile]` with `settings`. Raises PlanError."""
    given = dict(settings)
    applied = given.pop("compensate", "off")
    flags = int(compensation(applied))
    own = chosen(config, NAME, ProfileConfig, given, "compensate")
    trace = read(own.file, own.sha256)
    check_room(config, own.repeats * trace.duration_s)
    course = Course.of(trace.scaled(own.torque_factor, own.speed_factor), config, own.inertia_kg_m2)
    check(course, config, own, compensated=bool(flags))
    plan = Plan(
        name=NAME,
        points=tuple(_point(course, own, number) for number in range(own.repeats)),
        motion=partial(cycles, course, own, config.brake, flags),
        point_s=partial(cycle_s, course),
        settings={**own.model_dump(mode="json"), "sha256": trace.sha256, "compensate": applied},
        outlook=_outlook(course, own),
        continuous=True,
    )
    check_room(config, plan.seconds)
    return plan


def _point(course: Course, own: ProfileConfig, number: int) -> OperatingPoint:
    """Return the point of a cycle: its largest torque and speed, with their signs."""
    trace = course.trace
    torque_Nm, speed_Hz = (
        float(values[np.argmax(np.abs(values))]) for values in (trace.torque_Nm, trace.speed_Hz)
    )
    aim = f"cycle {number + 1} of {own.repeats}, {trace.duration_s:g} s of {trace.file}: up to "
    aim += f"{torque_Nm:.3g} Nm, {speed_Hz:.3g} Hz"
    return OperatingPoint(number, torque_Nm, speed_Hz, 0, aim=aim)


def _outlook(course: Course, own: ProfileConfig) -> str:
    trace = course.trace
    return (
        f"{trace.line.size} rows, sha256 {trace.sha256[:12]}..., "
        f"{own.repeats * trace.energy_J:.4g} J of mechanical energy"
    )


def cycle_s(course: Course, _: OperatingPoint) -> float:
    """Return an estimate of the time that `cycle` takes (s)."""
    return REST_S + course.seconds


def cycles(
    course: Course,
    own: ProfileConfig,
    brake: BrakeConfig,
    compensate: int,
    points: tuple[OperatingPoint, ...],
) -> Motion[None]:
    """Enable, play each cycle, ramp down."""
    play = partial(cycle, course=course, own=own, servo=BrakeServo(brake))
    yield from take_points(play, points, compensate)


@restartable
def cycle(
    point: OperatingPoint, course: Course, own: ProfileConfig, servo: BrakeServo
) -> Motion[Capture]:
    """Come to rest, play the course, capture it from the trace's first row to its last."""
    demand = (yield None).demand.at_rest(
        enabled=True, speed_Hz=0.0, label=f"cycle {point.index + 1} of {own.repeats}"
    )
    began = yield from within(
        REST_TIMEOUT_S,
        brake_to_rest(demand.labelled("coming to rest"), _rests),
        lambda seen: f"{demand.label}: the rotor still turns at {seen.speed_Hz:.3g} Hz",
    )
    seen, start_s = yield from _play(point, course, own, servo, demand, began)
    fault = (
        ""
        if abs(seen.point_turns) > 0 or not course.trace.speed_Hz.any()
        else "the rotor stood still"
    )
    return account(
        point,
        seen,
        quality(seen, own.temperature_C, fault),
        profile_start_s=round(start_s, 6),
        profile_s=round(course.trace.duration_s, 6),
    )


def _rests(seen: Observation) -> bool:
    return abs(seen.speed_Hz) < STANDSTILL_Hz and seen.torque_set_Nm == 0.0


def _play(
    point: OperatingPoint,
    course: Course,
    own: ProfileConfig,
    servo: BrakeServo,
    demand: Demand,
    began: Observation,
) -> Motion[tuple[Observation, float]]:
    """Play the course; return the end of its capture, and the trace's time at the beginning.

    What is demanded is that of the middle of the time until the next observation.
    """
    servo.start()
    seen, step_s, followed, start_s = began, 0.0, began, None
    while True:
        at_s = course.begins_s + seen.since_s(began)
        ended = at_s >= course.trace.duration_s and seen.plan_point == point.index
        if start_s is not None and ended:
            return seen, start_s
        torque_Nm, speed_Hz, brake = course.wanted(at_s + 0.5 * step_s)
        captured = at_s >= 0
        start_s = at_s if captured and start_s is None else start_s
        before = seen
        seen = yield replace(
            demand.labelled("playing" if captured else "on the way to its first row"),
            torque_Nm=torque_Nm,
            speed_Hz=speed_Hz,
            brake=min(brake * exp(0.5 * servo.shift), 1.0),
            plan_point=point.index if captured else -1,
        )
        step_s = min(seen.since_s(before), 0.2)
        _correct(servo, seen, speed_Hz)
        if abs(seen.speed_Hz - speed_Hz) <= own.speed_error_max_Hz:
            followed = seen
        elif seen.since_s(followed) > ASTRAY_S:
            raise MotionFailed(_why_astray(seen, at_s, own))


def _correct(servo: BrakeServo, seen: Observation, wanted_Hz: float) -> None:
    """Correct the brake's curve, where the rotor turns about as it should."""
    if abs(wanted_Hz) >= SERVO_FROM_Hz and abs(seen.speed_Hz / wanted_Hz - 1.0) < SERVO_BAND:
        servo.correct(seen.t_ns, seen.speed_Hz, wanted_Hz)
        servo.shift = min(max(servo.shift, -SHIFT_LIMIT), SHIFT_LIMIT)


def _why_astray(seen: Observation, at_s: float, own: ProfileConfig) -> str:
    fast = abs(seen.speed_Hz) > abs(seen.demand.speed_Hz)
    hint = (
        "does the brake answer, is its curve in [brake] right?"
        if fast
        else "is the rotor free, and the torque above friction and cogging torque?"
    )
    return (
        f"{seen.demand.label}: at t = {at_s:.1f} s the rotor turned at {seen.speed_Hz:.3g} Hz in "
        f"the place of {seen.demand.speed_Hz:.3g}, for more than {ASTRAY_S:g} s further off than "
        f"speed_error_max_Hz = {own.speed_error_max_Hz:g}; {hint}"
    )
