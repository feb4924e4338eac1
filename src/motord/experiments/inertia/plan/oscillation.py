"""`inertia-oscillation`: somebody deflects a bar between its springs and lets go.

The power stage is off meanwhile: no current may act on the rotor.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from motord.config import Config, OscillationConfig
from motord.schema import State
from motord.sequencing import Demand, Observation, OperatingPoint, Plan
from motord.sequencing.capture import account, retaken_if_poor
from motord.sequencing.motions import (
    Capture,
    Motion,
    Restarted,
    guarded,
    hold,
    ramp_down,
    restartable,
    within,
)
from motord.sequencing.quality import quality
from motord.sequencing.settings import chosen

NAME = "inertia-oscillation"

DEFLECT_S = 3.0
"""What somebody takes to deflect the bar, hold it and let go, for the estimate of time."""

STILL_PART = 0.1
"""Part of the least deflection within which a bar that is held still may move."""

BACK_PART = 0.6
"""Part of its path by which a bar that was let go is seen to come back; a pulled one stays."""

FADED_S = 0.3
"""Time over which the oscillation must have stayed small; periods are shorter."""


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.inertia-oscillation]` with `settings`. Raises PlanError."""
    own = chosen(config, NAME, OscillationConfig, settings)
    return Plan(
        name=NAME,
        points=tuple(OperatingPoint(n, 0.0, 0.0, 0, aim="a release") for n in range(own.repeats)),
        motion=partial(releases, own),
        point_s=partial(oscillation_s, own),
        settings=own.model_dump(mode="json"),
        needs="",
        ends_s=0.0,
    )


def releases(own: OscillationConfig, points: tuple[OperatingPoint, ...]) -> Motion[None]:
    """Wait for one release after the other."""
    for point in points:
        yield from retaken_if_poor(release, point, own)


def oscillation_s(own: OscillationConfig, _: OperatingPoint) -> float:
    """Return an estimate of the time that `release` takes (s)."""
    return DEFLECT_S + own.swing_max_s


@restartable
def release(point: OperatingPoint, own: OscillationConfig) -> Motion[Capture]:
    """Wait until the bar is held still, is let go and swings, and until that has faded.

    A power stage that is on is switched off first: its currents would act on the rotor.
    """
    seen = yield None
    if seen.state is State.ENABLED:
        yield Demand(enabled=True, label="switching off")  # a fall disables, so it has to rise
        yield from within(own.timeout_s, ramp_down(), partial(_late, own))
    return (yield from guarded(_release(point, own), _begin_again_if_enabled))


def _late(own: OscillationConfig, seen: Observation) -> str:
    return (
        f"{seen.demand.label}: nothing let go within {own.timeout_s:g} s: deflect the bar between "
        f"its springs by {own.deflection_min_rad:g} rad or more, hold it still, let go; a "
        "simulated rig needs such a bar, [swing], as that of the packaged inertia.toml"
    )


def _begin_again_if_enabled(seen: Observation) -> str:
    if seen.state is State.ENABLED:
        raise Restarted
    return ""


def _release(point: OperatingPoint, own: OscillationConfig) -> Motion[Capture]:
    """Capture a release, from the hold before it until its swing has faded."""
    idle = Demand(label=f"release {point.index + 1}")
    captured = replace(idle, plan_point=point.index)
    left, bar = yield from within(own.timeout_s, _let_go(idle, captured, own), partial(_late, own))
    range_rad = _Range(FADED_S)
    seen = yield from hold(
        captured.labelled("swinging"),
        lambda seen: (
            range_rad(seen) < 2 * own.amplitude_min_rad or seen.since_s(left) > own.swing_max_s
        ),
    )
    return account(
        point,
        seen,
        quality(seen, own.temperature_C),
        turns=0.0,
        speed_mean_Hz=0.0,
        swing={
            "deflection_rad": round(bar.furthest_rad / 2, 5),
            "seconds": round(seen.since_s(left), 3),
        },
    )


@dataclass
class _Deflection:
    """Where the bar was held, and how far it has been from there."""

    held_rad: float
    furthest_rad: float = 0.0

    def follow(self, seen: Observation) -> None:
        for angle_rad in (seen.lowest_rad, seen.highest_rad):
            self.furthest_rad = max(self.furthest_rad, abs(angle_rad - self.held_rad))


class _Range:
    """The range of the angle over the last `span_s`, from one observation to the next."""

    def __init__(self, span_s: float) -> None:
        self._span_s = span_s
        self._seen: deque[Observation] = deque()

    def __call__(self, seen: Observation) -> float:
        """Return the range (rad); infinite before the span has passed."""
        self._seen.append(seen)
        while len(self._seen) > 1 and seen.since_s(self._seen[1]) >= self._span_s:
            self._seen.popleft()
        if seen.since_s(self._seen[0]) < self._span_s:
            return math.inf
        later = list(self._seen)[1:]  # the block of the oldest lies before the span
        return max(each.highest_rad for each in later) - min(each.lowest_rad for each in later)


def _let_go(
    idle: Demand, captured: Demand, own: OscillationConfig
) -> Motion[tuple[Observation, _Deflection]]:
    """Return where the bar left the hold, and its deflection, once it has come back.

    At rest the bar is still, too: then it is pulled, which is no release since it stays there.
    """
    hold_still = "deflect the bar and hold it still"
    free = idle.labelled(hold_still)
    while True:
        bar = _Deflection((yield from _still(free, own)).turned_rad)
        left = yield from _leaves(captured.labelled("let go"), bar, own)
        came_back = yield from _comes_back(captured.labelled("moving"), bar, own)
        if came_back and bar.furthest_rad >= 2 * own.deflection_min_rad:
            return left, bar
        if came_back:
            free = idle.labelled(f"{hold_still} (by {own.deflection_min_rad:g} rad at least)")
        yield free


def _still(demand: Demand, own: OscillationConfig) -> Motion[Observation]:
    seen = yield None
    range_rad = _Range(own.still_s)
    while range_rad(seen) >= STILL_PART * own.deflection_min_rad:
        seen = yield demand
    return seen


def _leaves(demand: Demand, bar: _Deflection, own: OscillationConfig) -> Motion[Observation]:
    while True:
        seen = yield demand
        bar.follow(seen)
        if bar.furthest_rad > own.deflection_min_rad / 2:
            return seen


def _comes_back(demand: Demand, bar: _Deflection, own: OscillationConfig) -> Motion[bool]:
    """Return whether the bar comes back before it is still."""
    range_rad = _Range(own.still_s)
    while True:
        seen = yield demand
        bar.follow(seen)
        still = range_rad(seen) < STILL_PART * own.deflection_min_rad
        if abs(seen.turned_rad - bar.held_rad) <= BACK_PART * bar.furthest_rad:
            return True
        if still:
            return False
