"""Runs one plan at a time on the bench: observations in, demands into the set-point.

A detached plan is its own commander: while it runs and nobody holds the lease, the lease shows as
held by the plan, and losing a lease does not end it. Any other plan ends with the lease of whoever
is in command.
"""

from typing import Any, Literal
from uuid import uuid4

from motord.api.messages import PlanView
from motord.schema import Compensate, Request
from motord.sequencing import Demand, Executor, Observation, Plan
from motord.service.plans.resume import RemainingPlan, Resumption
from motord.service.setpoint import RAD_PER_TURN, Setpoint


class PlanRunner:
    """The plan under way, or the last one."""

    def __init__(self, setpoint: Setpoint, journal: Resumption) -> None:
        self._setpoint = setpoint
        self._journal = journal
        self._executor: Executor | None = None
        self._demand = Demand()
        self._points_passed_on = 0
        self._compensate_before = Compensate(0)
        self._points_before = 0
        self.view: PlanView | None = None
        """Progress of the plan under way or of the last one."""
        self.active = False

    @property
    def detached(self) -> bool:
        """True while a detached plan runs."""
        return self.active and self.view is not None and self.view.detached

    def show(self, view: PlanView | None) -> None:
        """Show the progress of a plan of which there is no more than that, or of none."""
        self._executor, self.view = None, view

    def start(
        self,
        plan: Plan,
        started_by: str,
        notes: str,
        *,
        detached: bool,
        before: RemainingPlan | None = None,
    ) -> PlanView:
        """Begin a plan with the next look. None may be under way.

        `before` says what there was of it, if `plan` is only its rest.
        """
        self._executor, self._demand, self._points_passed_on = Executor(plan), Demand(), 0
        self._points_before = before.taken if before is not None else 0
        self.view = PlanView(
            **self._counted(self._executor.progress()),
            detached=detached,
            started_by=started_by,
            settings=plan.settings,
            run_id=before.log.plan.run_id if before is not None else uuid4().hex,
            continues=before.log.recordings[-1] if before is not None else "",
        )
        self.active = True
        self._compensate_before = self._setpoint.compensate
        self._setpoint.rest()
        recording = self._journal.plan_started(plan, self.view, notes)
        self.view = self.view.model_copy(update={"recording": recording})
        return self.view

    def look(self, seen: Observation) -> None:
        """Advance the plan by one observation and put what it demands into the set-point."""
        executor = self._executor
        if executor is None or not self.active:
            return
        self._apply(executor.advance(seen))
        for point in executor.points[self._points_passed_on :]:
            self._journal.plan_point(point)
        self._points_passed_on = len(executor.points)
        self._show(executor.progress())
        if executor.finished:
            self._finish()

    def pause(self) -> None:
        """Ramp to zero and wait."""
        if self._executor is not None:
            self._executor.pause()
            self._show(self._executor.progress())

    def resume(self) -> None:
        """Go on after a pause."""
        if self._executor is not None:
            self._executor.resume()
            self._show(self._executor.progress())

    def abort(self, why: str) -> None:
        """Ramp down, disable, end."""
        if self._executor is not None and self.active:
            self._executor.abort(why)
            self._show(self._executor.progress())

    def end(self, why: str, state: Literal["aborted", "failed"] = "failed") -> None:
        """End at once: the bench is stopped, or no longer there for the plan to ramp down."""
        if self._executor is None or not self.active:
            return
        self._show({**self._executor.progress(), "state": state, "message": why, "eta_s": 0.0})
        self._finish()

    def _apply(self, demand: Demand) -> None:
        s, before = self._setpoint, self._demand
        s.torque_Nm, s.speed_Hz = demand.torque_Nm, demand.speed_Hz or None
        s.brake, s.drive_Hz = demand.brake, demand.drive_rad_s / RAD_PER_TURN
        s.compensate, s.plan_point = Compensate(demand.compensate), demand.plan_point
        s.induced = demand.induced
        if demand.enabled != before.enabled:
            s.request(Request.ENABLE if demand.enabled else Request.DISABLE)
        self._demand = demand

    def _show(self, progress: dict[str, Any]) -> None:
        if self.view is not None:
            counted = self._counted(progress)
            self.view = PlanView.model_validate({**self.view.model_dump(), **counted})
            self._journal.plan_progress(self.view)

    def _counted(self, progress: dict[str, Any]) -> dict[str, Any]:
        """Return progress with the points of the whole plan."""
        counts = {key: progress[key] + self._points_before for key in ("points", "points_done")}
        return {**progress, **counts}

    def _finish(self) -> None:
        self.active = False
        self._setpoint.rest()
        self._setpoint.compensate = self._compensate_before
        if self.view is not None:
            self._journal.plan_over(self.view)
