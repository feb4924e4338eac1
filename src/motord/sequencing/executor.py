"""Walks through a plan: one observation in, one demand out. The same in virtual and real time."""

from collections.abc import Mapping
from dataclasses import replace
from enum import Enum
from typing import Any

from motord.schema import State, Trip
from motord.sequencing.observation import Observation
from motord.sequencing.quality import GOOD
from motord.sequencing.steps import (
    NOTHING_INDUCED,
    Advance,
    Demand,
    Outcome,
    Plan,
    Rest,
    Step,
    Steps,
)

TAKES_MAX = 3
"""A point of poor quality is taken again until it is good or was taken so often."""


class PlanState(Enum):
    """Where a plan stands."""

    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    ENDING = "ending"
    DONE = "done"
    ABORTED = "aborted"
    FAILED = "failed"


def _only(step: Step) -> Steps:
    yield step


def final(point: Mapping[str, Any]) -> bool:
    """Return whether an operating point, as it was taken, is not to be taken again."""
    return point.get("quality", GOOD) == GOOD or int(point.get("take", 1)) >= TAKES_MAX


class Executor:
    """Carries out one plan. Call `advance` with each observation until `finished`.

    `points` holds every take of every operating point, each with its number `take`; of several
    takes the last counts. `points_done`: points that are not to be taken again.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.state = PlanState.RUNNING
        self.message = ""
        self.points: list[dict[str, Any]] = []
        self.points_done = 0
        self._take = 1
        self._steps = plan.steps()
        self._step: Step | None = None
        self._demand = Demand()
        self._end = PlanState.DONE
        self._enabled_once = False
        self._began_ns = 0
        self._now_ns = 0
        self._seconds_done = 0.0
        self._step_began_ns = 0

    @property
    def finished(self) -> bool:
        """True once nothing more will be demanded."""
        return self.state in (PlanState.DONE, PlanState.ABORTED, PlanState.FAILED)

    def advance(self, seen: Observation) -> Demand:
        """Return what the bench should do now."""
        self._now_ns = seen.t_ns
        self._began_ns = self._began_ns or seen.t_ns
        if self.finished:
            return self._demand
        if self._lost_the_bench(seen):
            return self._demand
        if self.state in (PlanState.PAUSING, PlanState.PAUSED):
            return self._rest_in_pause(seen)
        if self._step is None:
            self._next_step(seen, None)
        elif self._step_began_ns == 0:
            self._begin_step(seen)
        while self._step is not None:
            advance = self._step.advance(seen, self._demand)
            self._demand = advance.demand
            if advance.outcome is Outcome.RUNNING:
                break
            self._finish_step(seen, advance)
        return self._demand

    def pause(self) -> None:
        """Ramp to zero and wait; the point under way is taken again after `resume`."""
        if self.state is PlanState.RUNNING:
            self.state = PlanState.PAUSING

    def resume(self) -> None:
        """Go on after `pause`."""
        if self.state in (PlanState.PAUSING, PlanState.PAUSED):
            self.state = PlanState.RUNNING
            if self._step is not None:
                self._step_began_ns = 0

    def abort(self, why: str = "aborted by the operator") -> None:
        """Ramp down, disable and end."""
        if not self.finished and self.state is not PlanState.ENDING:
            self._wind_down(PlanState.ABORTED, why)

    def progress(self) -> dict[str, Any]:
        """Return what an operator wants to see (Zenoh key `plan`)."""
        elapsed_s = (self._now_ns - self._began_ns) * 1e-9
        within_s = 0.0
        if self._step is not None and self._step_began_ns:
            step_s = self._step.seconds()
            within_s = min((self._now_ns - self._step_began_ns) * 1e-9, step_s)
        done_s = self._seconds_done + within_s
        fraction = 1.0 if self.state is PlanState.DONE else min(done_s / self.plan.seconds, 0.999)
        return {
            "plan": self.plan.name,
            "state": self.state.value,
            "step": self._step.label if self._step is not None else "",
            "message": self.message,
            "points": len(self.plan.points),
            "points_done": self.points_done,
            "fraction": round(fraction, 4),
            "elapsed_s": round(elapsed_s, 2),
            "eta_s": 0.0 if self.finished else round(max(self.plan.seconds - done_s, 0.0), 1),
            "speed_set_Hz": self._demand.speed_Hz,
            "torque_set_Nm": self._demand.torque_Nm,
        }

    def _next_step(self, seen: Observation, result: dict[str, Any] | None) -> None:
        try:
            self._step = next(self._steps) if self._step is None else self._steps.send(result)
        except StopIteration:
            self._step = None
            self.state = self._end
            return
        self._begin_step(seen)

    def _begin_step(self, seen: Observation) -> None:
        assert self._step is not None
        self._step_began_ns = seen.t_ns
        self._step.begin(seen)

    def _finish_step(self, seen: Observation, advance: Advance) -> None:
        assert self._step is not None
        if advance.outcome is Outcome.FAILED:
            if self.state is PlanState.ENDING:
                self._stop_here(PlanState.FAILED, advance.message)
            else:
                self._wind_down(PlanState.FAILED, advance.message)
                self._next_step(seen, None)
            return
        if advance.point is not None:
            point = {**advance.point, "take": self._take}
            self.points.append(point)
            if not final(point):
                self._take += 1
                self._begin_step(seen)
                return
            self.points_done += 1
        self._take = 1
        self._seconds_done += self._step.seconds()
        self._enabled_once = self._enabled_once or seen.state is State.ENABLED
        self._next_step(seen, advance.point)

    def _wind_down(self, end: PlanState, why: str) -> None:
        self.state, self._end, self.message = PlanState.ENDING, end, why
        self._steps = _only(Rest())
        self._step = None

    def _lost_the_bench(self, seen: Observation) -> bool:
        """End at once if the bench tripped, or left ENABLED without being asked."""
        if seen.state is State.TRIPPED:
            causes = ", ".join(t.name or "" for t in Trip if t & seen.trip_bits)
            self._stop_here(PlanState.FAILED, f"the bench tripped: {causes}")
            return True
        expected = self._enabled_once and self.state is PlanState.RUNNING and self._demand.enabled
        if expected and seen.state in (State.OFF, State.READY):
            self._stop_here(PlanState.ABORTED, "the bench was disabled or stopped")
            return True
        return False

    def _stop_here(self, state: PlanState, why: str) -> None:
        self.state, self.message, self._step = state, why, None
        self._demand = Demand()

    def _rest_in_pause(self, seen: Observation) -> Demand:
        self._demand = replace(
            self._demand,
            torque_Nm=0.0,
            drive_rad_s=0.0,
            plan_point=-1,
            induced=NOTHING_INDUCED,
        )
        if seen.torque_set_Nm == 0.0:
            self.state = PlanState.PAUSED
        return self._demand
