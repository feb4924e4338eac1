"""Carries out a plan: one observation in, one demand out. The same in virtual and real time."""

from enum import Enum
from typing import Any

from motord.schema import State, Trip
from motord.sequencing.capture import final
from motord.sequencing.demand import Demand
from motord.sequencing.motions import Capture, Motion, MotionFailed, Restarted, ramp_down
from motord.sequencing.observation import Observation
from motord.sequencing.plan import Plan


class PlanState(Enum):
    """Where a plan stands."""

    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    ENDING = "ending"
    DONE = "done"
    ABORTED = "aborted"
    FAILED = "failed"


class Executor:
    """Carries out one plan. Call `advance` with each observation until `finished`.

    `points` holds every take of every operating point, each with its number `take`; of several
    takes the last counts. `points_done`: points that are not to be taken again.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.state = PlanState.RUNNING
        self.message = ""
        self.points: list[Capture] = []
        self.points_done = 0
        self._motion: Motion[Any] = plan.motion(plan.points)
        self._begun = False
        self._restart = False
        self._demand = Demand()
        self._end = PlanState.DONE
        self._was_enabled = False
        self._began_ns = 0
        self._now_ns = 0
        self._point_began_ns = 0
        self._points_done_s = 0.0

    @property
    def finished(self) -> bool:
        """True once nothing more will be demanded."""
        return self.state in (PlanState.DONE, PlanState.ABORTED, PlanState.FAILED)

    @property
    def over(self) -> bool:
        """True once no further point will be taken."""
        return self.finished or self.state is PlanState.ENDING

    def advance(self, seen: Observation) -> Demand:
        """Return what the bench should do now."""
        self._now_ns = seen.t_ns
        self._began_ns = self._began_ns or seen.t_ns
        self._point_began_ns = self._point_began_ns or seen.t_ns
        if self.finished or self._lost_the_bench(seen):
            return self._demand
        if self.state in (PlanState.PAUSING, PlanState.PAUSED):
            return self._rest_in_pause(seen)
        self._demand = self._next_demand(seen._replace(demand=self._demand))
        return self._demand

    def pause(self) -> None:
        """Ramp to zero and wait; the point under way is taken again after `resume`."""
        if self.state is PlanState.RUNNING:
            self.state = PlanState.PAUSING

    def resume(self) -> None:
        """Go on after `pause`."""
        if self.state in (PlanState.PAUSING, PlanState.PAUSED):
            self.state = PlanState.RUNNING
            self._restart = self._begun
            self._point_began_ns = 0

    def abort(self, why: str = "aborted by the operator") -> None:
        """Ramp down, disable and end."""
        if not self.finished and self.state is not PlanState.ENDING:
            self._wind_down(PlanState.ABORTED, why)

    def progress(self) -> dict[str, Any]:
        """Return what an operator wants to see (Zenoh key `plan`)."""
        elapsed_s = (self._now_ns - self._began_ns) * 1e-9
        done_s = self._points_done_s + self._under_way_s()
        fraction = 1.0 if self.state is PlanState.DONE else min(done_s / self.plan.seconds, 0.999)
        return {
            "plan": self.plan.name,
            "state": self.state.value,
            "step": self._demand.label,
            "message": self.message,
            "points": len(self.plan.points),
            "points_done": self.points_done,
            "fraction": round(fraction, 4),
            "elapsed_s": round(elapsed_s, 2),
            "eta_s": 0.0 if self.finished else round(max(self.plan.seconds - done_s, 0.0), 1),
            "speed_set_Hz": self._demand.speed_Hz,
            "torque_set_Nm": self._demand.torque_Nm,
        }

    def _under_way_s(self) -> float:
        """Return how much of the estimated time of the point under way has passed."""
        if self._point_began_ns == 0 or self.over:
            return 0.0
        left = self.plan.points[self.points_done :]
        part_s = self.plan.point_s(left[0]) if left else self.plan.ends_s
        return min((self._now_ns - self._point_began_ns) * 1e-9, part_s)

    def _next_demand(self, seen: Observation) -> Demand:
        """Carry on the motion until it demands something."""
        try:
            asked = self._carry_on(seen)
            while not isinstance(asked, Demand):
                if asked is not None:
                    self._note(asked)
                asked = self._motion.send(seen)
            return asked
        except StopIteration as end:
            return self._stop_here(self._end, self.message or end.value or "")
        except MotionFailed as failed:
            if self.state is PlanState.ENDING:
                return self._stop_here(PlanState.FAILED, str(failed))
            self._wind_down(PlanState.FAILED, str(failed))
            return self._next_demand(seen)

    def _carry_on(self, seen: Observation) -> Demand | Capture | None:
        if not self._begun:
            self._begun = True
            return next(self._motion)
        if self._restart:
            self._restart = False
            return self._motion.throw(Restarted())
        return self._motion.send(seen)

    def _note(self, captured: Capture) -> None:
        self.points.append(captured)
        self._point_began_ns = self._now_ns
        if final(captured):
            self._points_done_s += self.plan.point_s(self.plan.points[self.points_done])
            self.points_done += 1

    def _wind_down(self, end: PlanState, why: str) -> None:
        self.state, self._end, self.message = PlanState.ENDING, end, why
        self._motion = ramp_down()
        self._begun = self._restart = False

    def _lost_the_bench(self, seen: Observation) -> bool:
        """End at once if the bench tripped, or left ENABLED without being asked."""
        if seen.state is State.TRIPPED:
            causes = ", ".join(t.name or "" for t in Trip if t & seen.trip_bits)
            step = f" (step: {self._demand.label})" if self._demand.label else ""
            self._stop_here(PlanState.FAILED, f"the bench tripped: {causes}{step}")
            return True
        expected = self.state is PlanState.RUNNING and self._demand.enabled
        if expected and self._was_enabled and seen.state in (State.OFF, State.READY):
            self._stop_here(PlanState.ABORTED, "the bench was disabled or stopped")
            return True
        if not self._demand.enabled:
            self._was_enabled = False  # a plan may switch off and enable again
        elif expected and seen.state is State.ENABLED:
            self._was_enabled = True
        return False

    def _stop_here(self, state: PlanState, message: str) -> Demand:
        self.state, self.message, self._demand = state, message, Demand()
        return self._demand

    def _rest_in_pause(self, seen: Observation) -> Demand:
        self._demand = self._demand.at_rest()
        if seen.torque_set_Nm == 0.0:
            self.state = PlanState.PAUSED
        return self._demand
