"""Operating points one after the other without a wait: the brake's excitation stays as it is.

At constant excitation the torque of an eddy-current brake grows with the speed, so speed follows
torque within the rotor's time constant: each torque has a speed of its own, and torque of the other
sign turns the rotor the other way. The brake itself, which is slow, is never waited for.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

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
from motord.sequencing.precision import Precision
from motord.sequencing.quality import quality

SETTLE_S = 0.15
"""Time at a point's torque before its capture: the rotor's speed and the mount settle."""

START_S = 0.2
"""Time until the bench is enabled, about."""

END_S = 0.2
"""Time in which the bench is disabled after the last ramp, about."""

BEYOND_TURNS = 0.02
"""What is captured more, so that the encoder's counts have turned as far as the angle."""

PAUSED = 2.0
"""A point that took so many times as long was paused meanwhile."""

REACH_TIMEOUT_S = 10.0
"""Time within which the torque must be reached."""

TORQUE_REACHED_Nm = 1e-3


@dataclass(frozen=True)
class Continuous:
    """How points are taken without a wait.

    excitation: of the brake, 0 to 1; band_C: of the inverter's temperature, None for any;
    durations_s: of each point by its number, the transition before it included; least_points: taken
    whatever the time; targets: half-widths at which it ends.
    """

    excitation: float
    rate_Nm_per_s: float
    durations_s: tuple[float, ...]
    limit_s: float = math.inf
    least_points: int = 0
    compensate: int = 0
    band_C: tuple[float, float] | None = None
    targets: Mapping[str, float] = field(default_factory=dict)

    def duration_s(self, point: OperatingPoint) -> float:
        """Return how long a point should take."""
        return self.durations_s[point.index]


def point_s(point: OperatingPoint) -> float:
    """Return how long a point should take from its torque on (s)."""
    return SETTLE_S + point.turns / abs(point.speed_Hz)


def continuous_points(settings: Continuous, points: tuple[OperatingPoint, ...]) -> Motion[str]:
    """Enable, take the operating points, ramp down; return why it ended.

    Those are not taken that are left when the targets are reached, or for which the time is short.
    """
    yield from enable(settings.compensate)
    planned_s, passed_s, why = 0.0, START_S, ""
    for number, point in enumerate(points):
        begun, own_s = (yield None), settings.duration_s(point)
        slower = max((passed_s - START_S) / planned_s, 1.0) if number else 1.0
        end_s = abs(point.torque_Nm) / settings.rate_Nm_per_s + END_S
        if number >= settings.least_points and passed_s + slower * own_s + end_s > settings.limit_s:
            why = f"time limit of {settings.limit_s:g} s: {number} of {len(points)} points taken"
            break
        reached = yield from _unless_reached(point, settings)
        if reached is not None:
            why = f"targets reached: {reached.in_words(settings.targets)}"
            break
        planned_s += own_s
        passed_s += min((yield None).since_s(begun), PAUSED * own_s)  # a pause takes no bench time
    yield from ramp_down()
    return why


@restartable
def _unless_reached(point: OperatingPoint, settings: Continuous) -> Motion[Precision | None]:
    """Take a point; give it up as soon as the targets are reached, and return by what."""
    motion = retaken_if_poor(_point, point, settings)
    asked = next(motion)
    while True:
        seen = yield asked
        if seen.precision is not None and seen.precision.reaches(settings.targets):
            motion.close()
            return seen.precision
        try:
            asked = motion.send(seen)
        except StopIteration:
            return None


def _point(point: OperatingPoint, settings: Continuous) -> Motion[Capture]:
    """Ramp to the point's torque, let the speed follow, capture whole turns from where it is."""
    demand = replace(
        (yield None).demand,
        enabled=True,
        torque_Nm=point.torque_Nm,
        speed_Hz=point.speed_Hz,
        brake=settings.excitation,
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
    seen = yield from capture(point, demand.labelled("capturing"), BEYOND_TURNS)
    return account(point, seen, quality(seen, settings.band_C), turns_from_start=True)


def _reached(seen: Observation, torque_Nm: float) -> bool:
    return abs(seen.torque_set_Nm - torque_Nm) < TORQUE_REACHED_Nm
