"""Take one release of a bar between springs: held still, let go, swinging until it fades."""

import math
from collections import deque
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

from motord.config import OscillationConfig
from motord.schema import State
from motord.sequencing.observation import Observation
from motord.sequencing.quality import of_swing
from motord.sequencing.steps import Advance, Demand, OperatingPoint, Outcome

HAND_S = 3.0
"""What a hand takes to deflect the bar, hold it and let go, for the estimate of time."""

STILL_PART = 0.1
"""Part of the least deflection within which a bar that is held still may move."""

BACK_PART = 0.6
"""Part of its way that a bar is seen to come back by when it swings; one that is pulled stays."""

FADED_S = 0.3
"""Time over which the swing must have stayed small; periods are shorter."""


class Phase(Enum):
    """What is waited for."""

    STILL = "deflect the bar and hold it still"
    HELD = "let go"
    MOVING = "moving"
    SWING = "swinging"


@dataclass
class TakeSwing:
    """Watches the angle; marks ticks while the bar is held and while it swings.

    A power stage that is on is switched off first: its currents would act on the rotor. At rest
    the bar is still, too: then it is pulled, which is no swing since it does not come back.
    """

    point: OperatingPoint
    swing: OscillationConfig
    phase: Phase = Phase.STILL
    _began_ns: int = 0
    _left_ns: int = 0
    _held_rad: float = 0.0
    _furthest_rad: float = 0.0
    _hint: str = ""
    _looks: deque[Observation] = field(default_factory=deque)

    @property
    def label(self) -> str:
        """Number of the release and what is waited for, in words."""
        return f"release {self.point.index + 1}: {self.phase.value}{self._hint}"

    def begin(self, seen: Observation) -> None:
        """Start over."""
        self.phase, self._began_ns, self._hint = Phase.STILL, seen.t_ns, ""
        self._looks.clear()

    def seconds(self) -> float:
        """Return what hand and swing take together (s)."""
        return HAND_S + self.swing.swing_max_s

    def advance(self, seen: Observation, demand: Demand) -> Advance:
        """Go through the phases."""
        idle = replace(demand, enabled=False, torque_Nm=0.0, plan_point=-1)
        if (seen.t_ns - self._began_ns) * 1e-9 > self.swing.timeout_s:
            why = f"{self.label}: nothing let go within {self.swing.timeout_s:g} s"
            return Advance(idle, Outcome.FAILED, why)
        if seen.state is State.ENABLED:  # a fall of `enabled` disables, so it has to rise first
            self.phase = Phase.STILL
            return Advance(replace(idle, enabled=not demand.enabled))
        self._looks.append(seen)
        if self.phase is Phase.STILL:
            return Advance(self._wait_until_still(idle))
        marked = replace(idle, plan_point=self.point.index)
        if self.phase is Phase.HELD:
            self._watch_for_leaving(seen)
        elif self.phase is Phase.MOVING:
            if not self._tell_swing_from_pull(seen):
                return Advance(idle)
        elif self._faded(seen):
            return Advance(idle, Outcome.DONE, point=self._account(seen))
        return Advance(marked)

    def _span_rad(self, span_s: float) -> float:
        """Return how far the angle moved over the last `span_s`; infinite before that."""
        newest_ns = self._looks[-1].t_ns
        while len(self._looks) > 1 and (newest_ns - self._looks[1].t_ns) * 1e-9 >= span_s:
            self._looks.popleft()
        if (newest_ns - self._looks[0].t_ns) * 1e-9 < span_s:
            return math.inf
        looks = list(self._looks)[1:]  # the block of the oldest look lies before the span
        return max(look.highest_rad for look in looks) - min(look.lowest_rad for look in looks)

    def _is_still(self) -> bool:
        return self._span_rad(self.swing.still_s) < STILL_PART * self.swing.deflection_min_rad

    def _wait_until_still(self, idle: Demand) -> Demand:
        if not self._is_still():
            return idle
        self.phase, self._held_rad = Phase.HELD, self._looks[-1].turned_rad
        self._furthest_rad = 0.0
        return replace(idle, plan_point=self.point.index)

    def _follow(self, seen: Observation) -> None:
        for angle_rad in (seen.lowest_rad, seen.highest_rad):
            self._furthest_rad = max(self._furthest_rad, abs(angle_rad - self._held_rad))

    def _watch_for_leaving(self, seen: Observation) -> None:
        self._follow(seen)
        if self._furthest_rad > self.swing.deflection_min_rad / 2:
            self.phase, self._left_ns = Phase.MOVING, seen.t_ns
            self._looks.clear()

    def _tell_swing_from_pull(self, seen: Observation) -> bool:
        """Return whether this can still be, or now is, a swing; else what is still is awaited."""
        self._follow(seen)
        away_rad = abs(seen.turned_rad - self._held_rad)
        if away_rad > BACK_PART * self._furthest_rad:
            if not self._is_still():
                return True
        elif self._furthest_rad >= 2 * self.swing.deflection_min_rad:
            self.phase = Phase.SWING
            self._looks.clear()
            return True
        else:
            self._hint = f" (by {self.swing.deflection_min_rad:g} rad at least)"
        self.phase = Phase.STILL
        self._looks.clear()
        return False

    def _faded(self, seen: Observation) -> bool:
        elapsed_s = (seen.t_ns - self._left_ns) * 1e-9
        small = self._span_rad(FADED_S) < 2 * self.swing.amplitude_min_rad
        return small or elapsed_s > self.swing.swing_max_s

    def _account(self, seen: Observation) -> dict[str, Any]:
        """Return the release as it was taken (topic `/operating_point`)."""
        return {
            "index": self.point.index,
            "torque_Nm": 0.0,
            "speed_Hz": 0.0,
            "tick_start": seen.point_first_tick,
            "tick_end": seen.tick,
            "t_start_ns": seen.point_first_t_ns,
            "t_end_ns": seen.t_ns,
            "turns": 0.0,
            "speed_mean_Hz": 0.0,
            "brake": 0.0,
            "compensate": 0,
            "quality": of_swing(seen, self.swing),
            "swing": {
                "deflection_rad": round(self._furthest_rad / 2, 5),
                "seconds": round((seen.t_ns - self._left_ns) * 1e-9, 3),
            },
        }
