"""Take one speed of the externally driven rotor: drive, wait until it is steady, capture."""

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from motord.config import DrivenConfig
from motord.schema import State
from motord.sequencing.observation import Observation
from motord.sequencing.quality import of_capture
from motord.sequencing.steps import Advance, Demand, OperatingPoint, Outcome

APPROACH_s = 2.0
"""How long a drive is expected to take to a speed, for the estimate."""


class Phase(Enum):
    """What a point is waiting for."""

    SPIN_UP = "coming from above"
    SPEED = "waiting for the speed"
    SETTLE = "settling"
    CAPTURE = "capturing"


@dataclass
class DrivePoint:
    """Asks the drive for a speed, waits until the rotor's mean is steady, marks `turns` turns.

    from_Hz: speed that it comes from; none if that is not above the point's.
    """

    point: OperatingPoint
    driven: DrivenConfig
    from_Hz: float = 0.0
    phase: Phase = Phase.SPIN_UP
    _phase_began_ns: int = 0
    _began_ns: int = 0
    _steady_Hz: float = 0.0

    @property
    def label(self) -> str:
        """Speed and phase in words."""
        return f"driven at {self.point.speed_Hz:g} Hz: {self.phase.value}"

    def begin(self, seen: Observation) -> None:
        """Start over with the speed."""
        self._began_ns = seen.t_ns
        above = self.from_Hz > self.point.speed_Hz
        self._enter(Phase.SPIN_UP if above else Phase.SPEED, seen)

    def seconds(self) -> float:
        """Return approach, settling and turns together (s)."""
        turns = self.point.turns + (3 if self.from_Hz > self.point.speed_Hz else 1)
        return APPROACH_s + self.driven.settle_s + turns / self.point.speed_Hz

    def advance(self, seen: Observation, demand: Demand) -> Advance:
        """Go through the phases."""
        demand = replace(
            demand,
            enabled=False,
            torque_Nm=0.0,
            brake=0.0,
            speed_Hz=self.point.speed_Hz,
            drive_rad_s=2 * math.pi * self.point.speed_Hz,
            plan_point=-1,
        )
        if seen.state is State.OFF:
            return Advance(demand, Outcome.FAILED, f"{self.label}: the bench was stopped")
        elapsed_s = (seen.t_ns - self._phase_began_ns) * 1e-9
        if self.phase is Phase.SPIN_UP:
            return self._spin_up(seen, demand, elapsed_s)
        if self.phase is Phase.SPEED:
            return self._reach_speed(seen, demand, elapsed_s)
        if self.phase is Phase.SETTLE:
            return self._settle(seen, demand, elapsed_s)
        return self._capture(seen, demand, elapsed_s)

    def _enter(self, phase: Phase, seen: Observation) -> None:
        self.phase, self._phase_began_ns = phase, seen.t_ns

    def _spin_up(self, seen: Observation, demand: Demand, elapsed_s: float) -> Advance:
        """Go faster than the point; a belt that slips may not get all the way there."""
        fast = seen.turn_speed_Hz > 0.5 * (self.point.speed_Hz + self.from_Hz)
        if fast or elapsed_s > self.driven.settle_timeout_s / 3:
            self._enter(Phase.SPEED, seen)
            return Advance(demand)
        return Advance(replace(demand, drive_rad_s=2 * math.pi * self.from_Hz))

    def _reach_speed(self, seen: Observation, demand: Demand, elapsed_s: float) -> Advance:
        # the mean over a turn tells nothing of this point before a turn has passed
        off = abs(seen.turn_speed_Hz / self.point.speed_Hz - 1.0)
        if elapsed_s > 1.0 / self.point.speed_Hz and off < self.driven.speed_tolerance:
            self._steady_Hz = seen.turn_speed_Hz
            self._enter(Phase.SETTLE, seen)
        return Advance(demand) if self._in_time(seen) else self._too_late(seen, demand)

    def _settle(self, seen: Observation, demand: Demand, elapsed_s: float) -> Advance:
        """Wait while the mean speed holds still; start over from the speed it has moved to."""
        moved = abs(seen.turn_speed_Hz - self._steady_Hz) / self.point.speed_Hz
        if moved > self.driven.settle_tolerance:
            self._enter(Phase.SPEED, seen)
            return Advance(demand) if self._in_time(seen) else self._too_late(seen, demand)
        if elapsed_s < self.driven.settle_s:
            return Advance(demand)
        self._enter(Phase.CAPTURE, seen)
        return Advance(replace(demand, plan_point=self.point.index))

    def _in_time(self, seen: Observation) -> bool:
        return (seen.t_ns - self._began_ns) * 1e-9 <= self.driven.settle_timeout_s

    def _too_late(self, seen: Observation, demand: Demand) -> Advance:
        speed_Hz, wanted_Hz = seen.turn_speed_Hz, self.point.speed_Hz
        if abs(speed_Hz) < 0.1 * wanted_Hz:
            hint = "does the drive answer, is the belt on?"
        elif speed_Hz < 0:
            hint = "it turns the other way: reverse the drive, or [motor] encoder_direction"
        elif abs(speed_Hz / wanted_Hz - 1.0) < self.driven.speed_tolerance:
            hint = "it does not hold still: does the belt slip?"
        else:
            hint = "does the belt slip, is the drive's scale right?"
        return Advance(
            demand,
            Outcome.FAILED,
            f"driven at {wanted_Hz:g} Hz: the rotor turned at {speed_Hz:.3g} Hz after "
            f"{self.driven.settle_timeout_s:g} s; {hint}",
        )

    def _capture(self, seen: Observation, demand: Demand, elapsed_s: float) -> Advance:
        demand = replace(demand, plan_point=self.point.index)
        if seen.plan_point != self.point.index or abs(seen.point_turns) < self.point.turns:
            if elapsed_s > 3.0 * self.point.turns / self.point.speed_Hz + 5.0:
                return Advance(demand, Outcome.FAILED, f"{self.label}: the rotor stopped turning")
            return Advance(demand)
        return Advance(replace(demand, plan_point=-1), Outcome.DONE, point=self._account(seen))

    def _account(self, seen: Observation) -> dict[str, Any]:
        """Return the operating point as it was taken (topic `/operating_point`)."""
        return {
            "index": self.point.index,
            "torque_Nm": 0.0,
            "speed_Hz": self.point.speed_Hz,
            "tick_start": seen.point_first_tick,
            "tick_end": seen.tick,
            "t_start_ns": seen.point_first_t_ns,
            "t_end_ns": seen.t_ns,
            "turns": round(seen.point_turns, 3),
            "speed_mean_Hz": round(seen.point_speed_Hz, 5),
            "driven": True,
            "compensate": 0,
            "quality": of_capture(seen, self.point.speed_Hz, self.driven),
        }
