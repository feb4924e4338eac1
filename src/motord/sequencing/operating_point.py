"""Take one operating point: brake, torque, speed on its set-point, settle, capture."""

from dataclasses import asdict, dataclass, field, replace
from enum import Enum
from typing import Any

from motord.config import MeshConfig
from motord.sequencing.brake_servo import BrakeServo
from motord.sequencing.observation import Observation
from motord.sequencing.quality import of_capture
from motord.sequencing.steps import (
    NOTHING_INDUCED,
    Advance,
    Demand,
    Induced,
    OperatingPoint,
    Outcome,
)

BRAKE_LEAD_TIME_CONSTANTS = 4.0
"""How long a rising brake leads a rising torque, in time constants of its excitation."""


class Phase(Enum):
    """What a point is waiting for."""

    BRAKE = "bringing the brake up"
    SPEED = "waiting for the speed"
    SETTLE = "settling"
    CAPTURE = "capturing"


@dataclass
class TakePoint:
    """Holds torque by command and speed by the brake, then marks `turns` turns of ticks."""

    point: OperatingPoint
    mesh: MeshConfig
    servo: BrakeServo
    phase: Phase = Phase.BRAKE
    _phase_began_ns: int = 0
    _brake_before: float | None = field(default=None)

    @property
    def label(self) -> str:
        """Point and phase in words."""
        return f"{self.point.torque_Nm:g} Nm, {self.point.speed_Hz:g} Hz: {self.phase.value}"

    def begin(self, seen: Observation) -> None:
        """Start over with the brake."""
        self.servo.drop_unproven()
        self._brake_before = None
        self._enter(Phase.BRAKE, seen)

    def seconds(self) -> float:
        """Return brake, approach, settling and turns together (s)."""
        lead_s = BRAKE_LEAD_TIME_CONSTANTS * self.servo.brake.excitation_time_constant_s
        return lead_s + 3.0 + self.mesh.settle_s + self.point.turns / self.point.speed_Hz

    def advance(self, seen: Observation, demand: Demand) -> Advance:
        """Go through the phases."""
        elapsed_s = (seen.t_ns - self._phase_began_ns) * 1e-9
        if self.phase is Phase.BRAKE:
            return self._bring_brake_up(seen, demand, elapsed_s)
        if self.phase is Phase.SPEED:
            return self._reach_speed(seen, demand, elapsed_s)
        if self.phase is Phase.SETTLE:
            return self._settle(seen, demand, elapsed_s)
        return self._capture(seen, demand, elapsed_s)

    def _enter(self, phase: Phase, seen: Observation) -> None:
        self.phase, self._phase_began_ns = phase, seen.t_ns

    def _on_point(self, demand: Demand, **changes: Any) -> Demand:
        point = self.point
        changes.setdefault("torque_Nm", point.torque_Nm)
        return replace(
            demand, enabled=True, speed_Hz=point.speed_Hz, induced=point.induced, **changes
        )

    def _bring_brake_up(self, seen: Observation, demand: Demand, elapsed_s: float) -> Advance:
        """Let a rising brake lead the torque, so that the rotor does not run away meanwhile."""
        brake = self.servo.excitation(self.point.torque_Nm, self.point.speed_Hz)
        if self._brake_before is None:
            self._brake_before = demand.brake
        lead_s = BRAKE_LEAD_TIME_CONSTANTS * self.servo.brake.excitation_time_constant_s
        rising = brake > self._brake_before + 0.01
        held_Nm = min(demand.torque_Nm, self.point.torque_Nm)
        if rising and elapsed_s < lead_s:
            return Advance(self._on_point(demand, brake=brake, torque_Nm=held_Nm, plan_point=-1))
        self.servo.start(seen.t_ns)
        self._enter(Phase.SPEED, seen)
        return Advance(self._on_point(demand, brake=brake, plan_point=-1))

    def _servoed(self, seen: Observation, demand: Demand) -> Demand:
        self.servo.correct(seen.t_ns, seen.speed_Hz, self.point.speed_Hz)
        brake = self.servo.excitation(self.point.torque_Nm, self.point.speed_Hz)
        return self._on_point(demand, brake=brake, plan_point=-1)

    def _speed_error(self, seen: Observation) -> float:
        return abs(seen.turn_speed_Hz / self.point.speed_Hz - 1.0)

    def _reach_speed(self, seen: Observation, demand: Demand, elapsed_s: float) -> Advance:
        demand = self._servoed(seen, demand)
        # the mean over a turn tells nothing of this point before a turn has passed
        if (
            elapsed_s > 1.0 / self.point.speed_Hz
            and self._speed_error(seen) < self.mesh.speed_tolerance
        ):
            self._enter(Phase.SETTLE, seen)
        elif elapsed_s > self.mesh.settle_timeout_s:
            return Advance(demand, Outcome.FAILED, self._why_no_speed(seen))
        return Advance(demand)

    def _why_no_speed(self, seen: Observation) -> str:
        point = self.point
        hint = "does the brake answer?" if seen.speed_Hz > point.speed_Hz else "is the rotor free?"
        return (
            f"{point.torque_Nm:g} Nm, {point.speed_Hz:g} Hz: the speed was still "
            f"{seen.turn_speed_Hz:.3g} Hz after {self.mesh.settle_timeout_s:g} s; {hint}"
        )

    def _settle(self, seen: Observation, demand: Demand, elapsed_s: float) -> Advance:
        demand = self._servoed(seen, demand)
        if elapsed_s < self.mesh.settle_s:
            return Advance(demand)
        self._enter(Phase.CAPTURE, seen)
        return Advance(replace(demand, plan_point=self.point.index))

    def _capture(self, seen: Observation, demand: Demand, elapsed_s: float) -> Advance:
        demand = replace(demand, plan_point=self.point.index)
        if seen.plan_point != self.point.index or seen.point_turns < self.point.turns:
            if elapsed_s > 3.0 * self.point.turns / self.point.speed_Hz + 5.0:
                return Advance(demand, Outcome.FAILED, f"{self.label}: the rotor stopped turning")
            return Advance(demand)
        return Advance(
            replace(demand, plan_point=-1), Outcome.DONE, point=self._account(seen, demand)
        )

    def _account(self, seen: Observation, demand: Demand) -> dict[str, Any]:
        """Return the operating point as it was taken (topic `/operating_point`)."""
        return {
            "index": self.point.index,
            "torque_Nm": self.point.torque_Nm,
            "speed_Hz": self.point.speed_Hz,
            "tick_start": seen.point_first_tick,
            "tick_end": seen.tick,
            "t_start_ns": seen.point_first_t_ns,
            "t_end_ns": seen.t_ns,
            "turns": round(seen.point_turns, 3),
            "speed_mean_Hz": round(seen.point_speed_Hz, 5),
            "brake": round(demand.brake, 5),
            "compensate": demand.compensate,
            "quality": of_capture(seen, self.point.speed_Hz, self.mesh),
            **_told(self.point.induced),
        }


def _told(induced: Induced) -> dict[str, Any]:
    """Return the errors that were induced, for the account; nothing if there were none."""
    return {} if induced == NOTHING_INDUCED else {"induced": asdict(induced)}
