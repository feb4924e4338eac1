"""`check-calibration`: a few turns at one torque, with one phase's current scaled, and backwards.

Gains make torque that follows the current, cogging does not: turned backwards by the opposite
torque, the two are apart. With one phase's current scaled, the common gain shows.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from motord.config import Config
from motord.config.plans import CheckCalibrationConfig
from motord.sequencing import Demand, Induced, OperatingPoint, Plan, PlanError
from motord.sequencing.brake_servo import excitation_for, speed_held_rad_s
from motord.sequencing.continuous import (
    START_S,
    Continuous,
    continuous_points,
    fastest_Hz,
    lead_s,
    point_s,
)
from motord.sequencing.limits import check_operating_points
from motord.sequencing.motions import Motion, MotionFailed, hold, restartable, within
from motord.sequencing.observation import Observation, Precision
from motord.sequencing.settings import chosen, compensation

NAME = "check-calibration"

APPLIED = "calibration"
"""What is compensated: gains, offsets and cogging, which are tested; nothing learned, which adds
torque that none of them makes."""

ESTIMATOR = "motord.experiments.check_calibration.live:LiveCheck"

EVALUATED_S = 30.0
"""Time after the last turn in which a check before a plan must be evaluated: its process may still
be starting on a busy computer."""

ADVICE = "calibrate again, or start without the check (--no-check)"

UNCHECKED = ("calibrate", "align", NAME)
"""Plans that make a calibration or test it: none of them is to be checked before."""

TORQUE_SHARE = 0.85
"""Torque of the points in parts of what the motor may make: compensation needs some more."""


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.check-calibration]` with `settings`. Raises PlanError."""
    given = dict(settings)
    if given.pop("compensate", APPLIED) != APPLIED:
        raise PlanError(f"{NAME}: it tests the calibration, so compensate is always {APPLIED}")
    check = chosen(config, NAME, CheckCalibrationConfig, given, "compensate")
    most_Nm = min(config.motor.rated_torque_Nm, config.limits.torque_Nm)
    torque_Nm = check.torque_Nm or float(f"{TORQUE_SHARE * most_Nm:.6g}")
    check_operating_points(config, (torque_Nm,), (check.speed_Hz,))
    if check.speed_Hz > fastest_Hz(config):
        raise PlanError(
            f"{NAME}: speed_Hz = {check.speed_Hz:g} is above {fastest_Hz(config):.3g}, up to which "
            "a constant brake holds the rotor safely ([brake] critical_speed_rad_s, [limits] "
            "trip_speed_rad_s)"
        )
    excitation = excitation_for(config.brake, torque_Nm, 2 * math.pi * check.speed_Hz)
    points = _points(check, torque_Nm, partial(speed_held_rad_s, config.brake, excitation))
    rate_Nm_per_s = config.limits.torque_rate_Nm_per_s
    brake_leads_s = lead_s(config.brake, torque_Nm / rate_Nm_per_s)
    taking = Continuous(
        excitation,
        brake_leads_s,
        rate_Nm_per_s,
        tuple(torque_Nm / rate_Nm_per_s + point_s(point) for point in points),
        compensate=int(compensation(APPLIED)),
        band_C=check.temperature_C,
    )
    return Plan(
        name=NAME,
        points=points,
        motion=partial(continuous_points, taking),
        point_s=taking.duration_s,
        settings={**check.model_dump(mode="json"), "torque_Nm": torque_Nm, "compensate": APPLIED},
        ends_s=max(START_S, brake_leads_s) + torque_Nm / config.limits.ramp_down_Nm_per_s,
        continuous=True,
    )


def _points(
    check: CheckCalibrationConfig, torque_Nm: float, held_rad_s: Callable[[float], float]
) -> tuple[OperatingPoint, ...]:
    """Return the points; held_rad_s: the speed at which the brake holds a torque (Nm)."""
    scaled = Induced(gain=(check.scaled_gain, 1.0, 1.0))
    scaled_Hz = held_rad_s(torque_Nm * (2 + check.scaled_gain) / 3) / (2 * math.pi)
    last_Nm = torque_Nm * (-1.0 if check.directions == "both" else 0.5)
    return (
        OperatingPoint(0, torque_Nm, check.speed_Hz, check.turns),
        OperatingPoint(1, torque_Nm, scaled_Hz, check.turns - 1, scaled),
        OperatingPoint(2, last_Nm, held_rad_s(last_Nm) / (2 * math.pi), check.turns),
    )


def is_checked_before(plan: Plan) -> bool:
    """Return whether a plan rests on the calibration in force, so that it may be checked before."""
    return plan.settings.get("compensate", "off") != "off" and plan.name not in UNCHECKED


def check_before(check: Plan, calibration: Path) -> Plan:
    """Return the check as it comes before a plan: it fails unless it finds no drift.

    calibration: the file of the one in force.
    """
    return replace(
        check,
        motion=partial(_without_drift, check.motion),
        estimator=ESTIMATOR,
        estimator_options={"calibration": str(calibration), "points": len(check.points)},
    )


def _without_drift(
    take: Callable[[tuple[OperatingPoint, ...]], Motion[Any]], points: tuple[OperatingPoint, ...]
) -> Motion[str]:
    """Take the points, then wait at rest for what they show, and return it."""
    yield from take(points)
    found = yield from _evaluated(len(points))
    if found.obstacle:
        raise MotionFailed(f"{found.obstacle}; {ADVICE}")
    return found.remark


@restartable
def _evaluated(points: int) -> Motion[Precision]:
    """Wait until so many points are evaluated, or cannot be."""

    def known(seen: Observation) -> bool:
        found = seen.precision
        return found is not None and (bool(found.obstacle) or found.captures >= points)

    seen = yield from within(
        EVALUATED_S,
        hold(Demand(label="evaluating"), known),
        lambda _: f"not evaluated within {EVALUATED_S:g} s",
    )
    assert seen.precision is not None
    return seen.precision
