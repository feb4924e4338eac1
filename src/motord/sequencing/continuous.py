"""Operating points one after the other without a wait: the brake's excitation stays as it is.

At constant excitation the torque of an eddy-current brake grows with the speed, so speed follows
torque within the rotor's time constant: each torque has a speed of its own, and torque of the other
sign turns the rotor the other way. The brake itself, which is slow, is never waited for.
"""

import math
from dataclasses import replace

from motord.config import BrakeConfig
from motord.sequencing.brake_servo import excitation_for
from motord.sequencing.capture import account, capture, retaken_if_poor
from motord.sequencing.demand import OperatingPoint
from motord.sequencing.motions import (
    Capture,
    Motion,
    enable,
    hold,
    ramp_down,
    restartable,
    wait,
    within,
)
from motord.sequencing.observation import Observation
from motord.sequencing.quality import quality

SETTLE_S = 0.15
"""Time at a point's torque before its capture: the rotor's speed and the mount settle."""

REACH_TIMEOUT_S = 10.0
"""Time within which the torque must be reached."""

TORQUE_REACHED_Nm = 1e-3


def continuous_points(
    brake: BrakeConfig,
    compensate: int,
    band_C: tuple[float, float] | None,
    points: tuple[OperatingPoint, ...],
) -> Motion[None]:
    """Enable, take every operating point at the excitation of the strongest, ramp down."""
    excitation = constant_excitation(brake, points)
    yield from enable(compensate)
    for point in points:
        yield from retaken_if_poor(_point, point, excitation, band_C)
    yield from ramp_down()


def constant_excitation(brake: BrakeConfig, points: tuple[OperatingPoint, ...]) -> float:
    """Return the excitation (0 to 1) that holds the point of the largest torque at its speed."""
    strongest = max(points, key=lambda point: abs(point.torque_Nm))
    speed_rad_s = 2 * math.pi * strongest.speed_Hz
    return excitation_for(brake, strongest.torque_Nm, speed_rad_s)


@restartable
def _point(
    point: OperatingPoint, excitation: float, band_C: tuple[float, float] | None
) -> Motion[Capture]:
    """Ramp to the point's torque, let the speed follow, capture whole turns from where it is."""
    demand = replace(
        (yield None).demand,
        enabled=True,
        torque_Nm=point.torque_Nm,
        speed_Hz=point.speed_Hz,
        brake=excitation,
        plan_point=-1,
        induced=point.induced,
        label=f"{point.torque_Nm:g} Nm, about {point.speed_Hz:.2g} Hz",
    )
    yield from within(
        REACH_TIMEOUT_S,
        hold(demand.labelled("ramping"), lambda seen: _reached(seen, point.torque_Nm)),
        lambda seen: f"{demand.label}: the torque is still {seen.torque_set_Nm:.3g} Nm",
    )
    yield from wait(demand.labelled("settling"), SETTLE_S)
    seen = yield from capture(point, demand.labelled("capturing"))
    return account(point, seen, quality(seen, band_C), turns_from_start=True)


def _reached(seen: Observation, torque_Nm: float) -> bool:
    return abs(seen.torque_set_Nm - torque_Nm) < TORQUE_REACHED_Nm
