"""Take one step of torque: stop the rotor, let it rest, push it, follow it while it coasts."""

from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from motord.config import AccelerationConfig, BrakeConfig
from motord.sequencing.observation import Observation
from motord.sequencing.quality import of_push
from motord.sequencing.steps import Advance, Demand, OperatingPoint, Outcome

STANDSTILL_RAD = 0.01
"""Movement during a look below which the rotor counts as standing."""

BRAKE_TIME_CONSTANTS = 6.0
"""How long the brake needs to let go, in time constants of its excitation."""


class Phase(Enum):
    """What is waited for."""

    STOP = "stopping the rotor"
    RELEASE = "releasing the brake"
    REST = "resting"
    PUSH = "accelerating"
    COAST = "coasting"


@dataclass
class TakePush:
    """Marks ticks from the rest before the step to the end of the coasting after it."""

    point: OperatingPoint
    push: AccelerationConfig
    brake: BrakeConfig
    phase: Phase = Phase.STOP
    _phase_began_ns: int = 0
    _began_ns: int = 0
    _rest_rad: tuple[float, float] = (0.0, 0.0)  # where the rotor was while it rested

    @property
    def label(self) -> str:
        """Number, torque and phase in words."""
        return f"step {self.point.index + 1}, {self.point.torque_Nm:g} Nm: {self.phase.value}"

    def begin(self, seen: Observation) -> None:
        """Start over with a rotor that may be turning."""
        self._began_ns = seen.t_ns
        self._enter(Phase.STOP, seen)

    def seconds(self) -> float:
        """Return all phases together (s)."""
        return 1.5 + self._release_s + self.push.rest_s + self.push.coast_s

    @property
    def _release_s(self) -> float:
        return BRAKE_TIME_CONSTANTS * self.brake.excitation_time_constant_s

    def _enter(self, phase: Phase, seen: Observation) -> None:
        self.phase, self._phase_began_ns = phase, seen.t_ns

    def advance(self, seen: Observation, demand: Demand) -> Advance:
        """Go through the phases."""
        elapsed_s = (seen.t_ns - self._phase_began_ns) * 1e-9
        free = replace(demand, enabled=True, torque_Nm=0.0, brake=0.0, plan_point=-1)
        marked = replace(free, plan_point=self.point.index)
        if (seen.t_ns - self._began_ns) * 1e-9 > self.push.timeout_s + self.push.rest_s:
            return Advance(free, Outcome.FAILED, self._why_late())
        if self.phase is Phase.STOP:
            if seen.highest_rad - seen.lowest_rad > STANDSTILL_RAD or seen.torque_set_Nm != 0.0:
                return Advance(replace(free, brake=1.0))
            self._enter(Phase.RELEASE, seen)
        elif self.phase is Phase.RELEASE:
            if elapsed_s >= self._release_s:
                self._enter(Phase.REST, seen)
                self._rest_rad = (seen.turned_rad, seen.turned_rad)
                return Advance(marked)
        elif self.phase is Phase.REST:
            lowest_rad, highest_rad = self._rest_rad
            self._rest_rad = (
                min(lowest_rad, seen.lowest_rad),
                max(highest_rad, seen.highest_rad),
            )
            if elapsed_s >= self.push.rest_s:
                self._enter(Phase.PUSH, seen)
                return Advance(replace(marked, torque_Nm=self.point.torque_Nm))
            return Advance(marked)
        elif self.phase is Phase.PUSH:
            if abs(seen.speed_Hz) < self.push.stop_speed_Hz:
                return Advance(replace(marked, torque_Nm=self.point.torque_Nm))
            self._enter(Phase.COAST, seen)
            return Advance(marked)
        else:
            return self._coast(seen, free, marked, elapsed_s)
        return Advance(free)

    def _coast(self, seen: Observation, free: Demand, marked: Demand, elapsed_s: float) -> Advance:
        if elapsed_s < self.push.coast_s:
            return Advance(marked)
        return Advance(free, Outcome.DONE, point=self._account(seen, marked))

    def _why_late(self) -> str:
        if self.phase is Phase.PUSH:
            return (
                f"{self.label}: {self.push.stop_speed_Hz:g} Hz not reached; is the rotor free, and "
                "torque_Nm more than friction and cogging torque?"
            )
        return f"{self.label}: the rotor did not come to rest; does the brake answer?"

    def _account(self, seen: Observation, demand: Demand) -> dict[str, Any]:
        """Return the step as it was taken (topic `/operating_point`)."""
        return {
            "index": self.point.index,
            "torque_Nm": self.point.torque_Nm,
            "speed_Hz": 0.0,
            "tick_start": seen.point_first_tick,
            "tick_end": seen.tick,
            "t_start_ns": seen.point_first_t_ns,
            "t_end_ns": seen.t_ns,
            "turns": round(abs(seen.point_turns), 3),
            "speed_mean_Hz": round(seen.point_speed_Hz, 5),
            "brake": 0.0,
            "compensate": demand.compensate,
            "quality": of_push(seen, self._rest_rad[1] - self._rest_rad[0], self.push),
        }
