"""`check-calibration`: a few turns at one torque, with one phase's current scaled, and backwards.

Gains make torque that follows the current, cogging does not: turned backwards by the opposite
torque, the two are apart. With one phase's current scaled, the common gain shows.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

from motord.config import Config
from motord.config.plans import CheckCalibrationConfig
from motord.sequencing import Induced, OperatingPoint, Plan, PlanError
from motord.sequencing.continuous import SETTLE_S, continuous_points
from motord.sequencing.limits import check_operating_points
from motord.sequencing.settings import chosen, compensation

NAME = "check-calibration"

APPLIED = "calibration"
"""What is compensated: gains, offsets and cogging, which are tested; nothing learned, which adds
torque that none of them makes."""

TORQUE_SHARE = 0.85
"""Torque of the points in parts of what the motor may make: compensation needs some more."""


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.check-calibration]` with `settings`. Raises PlanError."""
    given = dict(settings)
    if given.pop("compensate", APPLIED) != APPLIED:
        raise PlanError(f"{NAME}: it tests the calibration, so compensate is always {APPLIED}")
    check = chosen(config, NAME, CheckCalibrationConfig, given, "compensate")
    most_Nm = min(config.motor.rated_torque_Nm, config.limits.torque_Nm)
    torque_Nm = check.torque_Nm or round(TORQUE_SHARE * most_Nm, 6)
    check_operating_points(config, (torque_Nm,), (check.speed_Hz,))
    ramp_s = torque_Nm / config.limits.torque_rate_Nm_per_s
    return Plan(
        name=NAME,
        points=_points(check, torque_Nm),
        motion=partial(
            continuous_points, config.brake, int(compensation(APPLIED)), check.temperature_C
        ),
        point_s=partial(_point_s, ramp_s),
        settings={
            **check.model_dump(mode="json"),
            "torque_Nm": torque_Nm,
            "compensate": APPLIED,
        },
        ends_s=0.1 + torque_Nm / config.limits.ramp_down_Nm_per_s,
    )


def _points(check: CheckCalibrationConfig, torque_Nm: float) -> tuple[OperatingPoint, ...]:
    """Return the points; at constant excitation of the brake the speed follows the torque."""
    speed_Hz, turns = check.speed_Hz, check.turns
    scaled = Induced(gain=(check.scaled_gain, 1.0, 1.0))
    scaled_Hz = speed_Hz * (2 + check.scaled_gain) / 3
    share = -1.0 if check.directions == "both" else 0.5
    return (
        OperatingPoint(0, torque_Nm, speed_Hz, turns),
        OperatingPoint(1, torque_Nm, scaled_Hz, turns - 1, scaled),
        OperatingPoint(2, share * torque_Nm, share * speed_Hz, turns),
    )


def _point_s(ramp_s: float, point: OperatingPoint) -> float:
    """Return an estimate of the time that a point takes (s); ramp_s: from zero to its torque."""
    return ramp_s + SETTLE_S + point.turns / abs(point.speed_Hz)
