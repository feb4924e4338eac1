"""Operating points one after the other without a wait, at constant excitation of the brake.

At constant excitation the torque of an eddy-current brake grows with the speed, so speed follows
torque within the rotor's time constant: each torque has a speed of its own, and torque of the other
sign turns the rotor the other way. That holds well below the brake's critical speed, where its
torque is largest, and once the excitation is there: the brake, which is slow, is waited for once,
before the first torque. Where the rotor turns so slowly that the time gets short, the excitation
is lowered between points.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from motord.config import BrakeConfig, Config
from motord.sequencing.capture import account, capture, retaken_if_poor
from motord.sequencing.demand import OperatingPoint
from motord.sequencing.limits import SPEED_MARGIN
from motord.sequencing.motions import (
    Capture,
    Motion,
    Restarted,
    enable,
    hold,
    ramp_down,
    restartable,
    wait,
    within,
)
from motord.sequencing.observation import Observation, Precision
from motord.sequencing.quality import quality

SETTLE_S = 0.1
"""Time at a point's torque before its capture: the rotor's speed and the mount settle."""

LEAD_TIME_CONSTANTS = 2.0
"""Time constants of the excitation by which the brake leads the end of the first ramp: it has three
quarters of its torque then, so the rotor turns a third too fast at most."""

LEAST_LEAD = 1.0
"""Time constants by which it leads the beginning of that ramp: on the way, torque that rises evenly
is never further ahead of the brake than at the end."""

CRITICAL_SHARE = 0.5
"""Highest speed in parts of the brake's critical speed: its torque can still rise by a quarter."""

START_S = 0.2
"""Time until the bench is enabled, about."""

SLOWER = 0.9
"""Speed that is reckoned with, in parts of that of the configured brake."""

END_S = 0.2
"""Time in which the bench is disabled after the last ramp, about."""

RESERVE_S = 0.1
"""Time that is kept where the brake is lowered: no two captures turn quite alike."""

RUN_UP = 1.06
"""Speed at the end of a capture, in parts of its mean: the rotor still runs up as it begins."""

BEYOND_TURNS = 0.05
"""What is captured more, so that the encoder's counts have turned as far as the angle."""

SPEED_TOLERANCE = 1.3
"""Factor by which the speed may be off, as the brake's curve is never quite the configured one."""

REACH_TIMEOUT_S = 10.0
"""Time within which the torque must be reached, besides that of its ramp."""


@dataclass(frozen=True)
class Continuous:
    """How points are taken without a wait.

    excitation: of the brake, 0 to 1; lead_s: what it needs before the first torque; band_C: of the
    inverter's temperature, None for any; durations_s: of each point by its number, the transition
    before it included; least_points: taken whatever the time; targets: half-widths at its end.
    """

    excitation: float
    lead_s: float
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


def lead_s(brake: BrakeConfig, ramp_s: float = 0.0) -> float:
    """Return how long the brake leads the first torque (s), which takes at least ramp_s to rise."""
    time_constant_s = brake.excitation_time_constant_s
    return max(LEAD_TIME_CONSTANTS * time_constant_s - ramp_s, LEAST_LEAD * time_constant_s)


def fastest_Hz(config: Config) -> float:
    """Return the highest speed at which nothing holds the rotor but the brake's own curve.

    Well below the critical speed, and below the over-speed trip even if the brake is weaker than
    configured.
    """
    trip_rad_s = SPEED_MARGIN * config.limits.trip_speed_rad_s / SPEED_TOLERANCE
    critical_rad_s = CRITICAL_SHARE * config.brake.critical_speed_rad_s
    return min(trip_rad_s, critical_rad_s) / (2 * math.pi)


def point_s(point: OperatingPoint) -> float:
    """Return how long a point should take from its torque on (s)."""
    return SETTLE_S + (point.turns + BEYOND_TURNS) / (SLOWER * abs(point.speed_Hz))


def continuous_points(settings: Continuous, points: tuple[OperatingPoint, ...]) -> Motion[str]:
    """Enable, take the operating points, ramp down; return why it ended.

    Those are not taken that are left when the targets are reached, or for which the time is short.
    Of a plan that was interrupted the points before these have had their part of the time.
    """
    began, before = (yield None), points[0].index
    yield from enable(settings.compensate, brake=settings.excitation)
    yield from _brake_up(settings, began)
    planned_s, takes_s, why, pace, least = 0.0, 0.0, "", settings, math.inf
    passed_s = max(START_S, settings.lead_s) + sum(settings.durations_s[:before])
    for number, point in enumerate(points, start=before):
        own_s = settings.duration_s(point)
        slower = max(takes_s / planned_s, 1.0) if planned_s else 1.0
        end_s = abs(point.torque_Nm) / settings.rate_Nm_per_s + END_S
        if number >= settings.least_points and passed_s + slower * own_s + end_s > settings.limit_s:
            taken = f"{number} of {before + len(points)} points taken"
            why = f"time limit of {settings.limit_s:g} s: {taken}"
            break
        visit = yield from _unless_reached(point, pace)
        if visit.reached is not None:
            why = f"targets reached: {visit.reached.to_text(settings.targets)}"
            break
        planned_s += visit.takes * own_s
        takes_s += visit.takes_s
        passed_s += visit.takes_s + visit.cut_short_s
        rest = points[number - before + 1 : max(settings.least_points - before, 0)]
        slower = visit.slower * (settings.excitation / pace.excitation) ** 2
        least = min(least, slower)
        if rest:
            left_s = settings.limit_s - passed_s
            pace = _paced(settings, slower, RUN_UP * SLOWER / least, rest, left_s)
    yield from ramp_down()
    return why


def _paced(
    settings: Continuous,
    slower: float,
    least_share: float,
    rest: Sequence[OperatingPoint],
    left_s: float,
) -> Continuous:
    """Return the settings for what is left of the least points, with less of the brake if need be.

    slower: time of a turn at the full excitation, in parts of what was reckoned with; it goes with
    the square of the excitation. least_share: of that square, with which the quickest point so far
    would have turned as fast as with the configured brake.
    """
    turning_s = sum(point_s(one) - SETTLE_S for one in rest)
    at_rest_s = sum(settings.durations_s[one.index] for one in rest) - turning_s
    left_s -= abs(rest[-1].torque_Nm) / settings.rate_Nm_per_s + END_S + RESERVE_S
    needed = (left_s - at_rest_s) / (slower * turning_s)
    share = min(max(needed, least_share), 1.0)
    return replace(settings, excitation=settings.excitation * math.sqrt(share))


@restartable
def _brake_up(settings: Continuous, began: Observation) -> Motion[Observation]:
    """Wait at zero torque until the excitation is there."""
    demand = replace(
        (yield None).demand, enabled=True, brake=settings.excitation, label="bringing the brake up"
    )
    return (yield from hold(demand, lambda seen: seen.since_s(began) >= settings.lead_s))


@dataclass
class _Visit:
    """A point's captures and their time, and that of takes which a pause cut short.

    reached: by what the targets are, so that it was given up. A pause itself takes no bench time.
    slower: time of a turn in the quickest capture, in parts of what was reckoned with.
    """

    takes: int = 0
    slower: float = math.inf
    takes_s: float = 0.0
    cut_short_s: float = 0.0
    reached: Precision | None = None


def _unless_reached(point: OperatingPoint, settings: Continuous) -> Motion[_Visit]:
    """Take a point; give it up as soon as the targets are reached."""
    motion, visit = retaken_if_poor(_point, point, settings), _Visit()
    begun = seen = yield None
    asked = next(motion)
    while True:
        try:
            seen = yield asked
        except Restarted as restarted:
            visit.cut_short_s += seen.since_s(begun)
            asked = motion.throw(restarted)
            begun = seen = yield asked
        if seen.precision is not None and seen.precision.reaches(settings.targets):
            motion.close()
            visit.reached = seen.precision
            return visit
        if isinstance(asked, dict):
            visit.takes += 1
            visit.takes_s += seen.since_s(begun)
            slower = SLOWER * abs(point.speed_Hz / asked["speed_mean_Hz"])
            visit.slower = min(visit.slower, slower)
            begun = seen
        try:
            asked = motion.send(seen)
        except StopIteration:
            return visit


@restartable
def _point(point: OperatingPoint, settings: Continuous) -> Motion[Capture]:
    """Ramp to the point's torque, let the speed follow, capture whole turns from where it is."""
    began = yield None
    demand = replace(
        began.demand,
        enabled=True,
        torque_Nm=point.torque_Nm,
        speed_Hz=point.speed_Hz,
        brake=settings.excitation,
        plan_point=-1,
        induced=point.induced,
        label=f"{point.torque_Nm:g} Nm, about {point.speed_Hz:.2g} Hz",
    )
    ramp_s = abs(point.torque_Nm - began.torque_set_Nm) / settings.rate_Nm_per_s
    yield from within(
        REACH_TIMEOUT_S + ramp_s,
        hold(
            demand.labelled("ramping"),
            lambda seen: math.isclose(seen.torque_set_Nm, point.torque_Nm, rel_tol=1e-6),
        ),
        lambda seen: f"{demand.label}: the torque is still {seen.torque_set_Nm:.3g} Nm",
    )
    yield from wait(demand.labelled("settling"), SETTLE_S)
    seen = yield from capture(point, demand.labelled("capturing"), BEYOND_TURNS)
    return account(point, seen, quality(seen, settings.band_C), turns_from_start=True)
