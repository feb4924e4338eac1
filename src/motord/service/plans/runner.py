"""Runs one plan at a time on the bench: observations in, demands into the set-point.

A detached plan is its own commander: while it runs and nobody holds the lease, the lease shows as
held by the plan, and losing a lease does not end it. Any other plan ends with the lease of whoever
is in command. However a plan ends, from then on it commands nothing; it is over once its recording
is closed, or is known not to be.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Literal
from uuid import uuid4

from motord.api.plan_messages import MeshView, PlanView
from motord.schema import Compensate, Request
from motord.sequencing import Demand, Executor, Observation, Plan
from motord.sequencing.executor import PlanState
from motord.sequencing.motions import Capture
from motord.service.estimator.link import EstimatorLink
from motord.service.plans import mesh
from motord.service.plans.resume import RemainingPlan, Resumption
from motord.service.plans.torque_error import MeasuredError
from motord.service.setpoint import RAD_PER_TURN, Setpoint

BEFORE = "check of the calibration before it: "
RETAKE = "motord plan resume takes the points that are missing"


@dataclass(frozen=True)
class WaitingPlan:
    """A plan that begins when the check of the calibration before it is done."""

    plan: Plan
    view: PlanView
    notes: str
    mesh: MeshView

    def shown(self, check: dict[str, Any]) -> dict[str, Any]:
        """Return the progress of the check as that of the plan."""
        words = {name: f"{BEFORE}{check[name]}" for name in ("step", "message") if check[name]}
        over = check["state"] in ("aborted", "failed")
        left_s = 0.0 if over else check["eta_s"] + self.plan.seconds
        return {
            **check,
            **{name: getattr(self.view, name) for name in ("plan", "points", "points_done")},
            **words,
            "fraction": 0.0,
            "eta_s": round(left_s, 1),
        }


class PlanRunner:
    """The plan under way, or the last one; `torque_error` is that of the capture of a point.

    `estimator` says while a plan runs how precise it is by now; without one no plan ends early.
    """

    def __init__(
        self, setpoint: Setpoint, journal: Resumption, torque_error: Callable[[int], MeasuredError]
    ) -> None:
        self._setpoint = setpoint
        self._journal = journal
        self._torque_error = torque_error
        self._executor: Executor | None = None
        self._enabled: bool | None = None  # as the plan last demanded; None: it has not yet
        self._points_passed_on = 0
        self._compensate_before = Compensate(0)
        self._points_before = 0
        self._waiting: WaitingPlan | None = None
        self._under_way: int | None = None
        self._ended: dict[str, Any] | None = None  # how, while its recording is being closed
        self.estimator: EstimatorLink | None = None
        self.view: PlanView | None = None
        """Progress of the plan under way or of the last one."""
        self.mesh: MeshView | None = None
        """Its operating points."""
        self.active = False
        """True while a plan commands the bench."""

    @property
    def closing(self) -> bool:
        """True while the recording of a plan that has ended is being closed."""
        return self._ended is not None

    @property
    def concluded(self) -> bool:
        """True if there is no plan that commands the bench or whose recording closes."""
        return not self.active and not self.closing

    @property
    def detached(self) -> bool:
        """True while a detached plan runs."""
        return self.active and self.view is not None and self.view.detached

    def show(self, view: PlanView | None, mesh: MeshView | None) -> None:
        """Show the progress of a plan of which there is no more than that, or of none."""
        self._executor, self.view, self.mesh = None, view, mesh

    def start(
        self,
        plan: Plan,
        started_by: str,
        notes: str,
        *,
        detached: bool,
        serial: str = "",
        before: RemainingPlan | None = None,
        check: Plan | None = None,
        run_id: str = "",
    ) -> PlanView:
        """Begin a plan with the next look. The one before must be `concluded`.

        `serial` is that of the motor, "" for the bench file's; `before` says what there was of it,
        if `plan` is only its rest; `check` is run first, and the plan fails if that fails.
        `run_id`: of its progress, "" for a new one.
        """
        self._points_before = before.taken if before is not None else 0
        view = PlanView(
            **self._counted(Executor(plan).progress()),
            detached=detached,
            started_by=started_by,
            serial=serial,
            settings=plan.settings,
            run_id=before.log.plan.run_id if before is not None else run_id or uuid4().hex,
            continues=before.recording if before is not None else "",
            targets=dict(plan.targets),
        )
        points = (
            before.mesh if before is not None else mesh.planned(plan.name, view.run_id, plan.points)
        )
        self.active = True
        self._compensate_before = self._setpoint.compensate
        self._waiting = WaitingPlan(plan, view, notes, points) if check is not None else None
        if check is None:
            return self._begin(plan, view, notes, points)
        return self._begin(check, view, notes, mesh.planned(check.name, view.run_id, check.points))

    def _begin(self, plan: Plan, view: PlanView, notes: str, points: MeshView) -> PlanView:
        """Begin a plan, or the check before it; `view` is that of the plan."""
        self._executor, self._enabled, self._points_passed_on = Executor(plan), None, 0
        self.mesh = points
        if self.estimator is not None:
            self.estimator.begin(plan)
        self._setpoint.rest()
        resumable = self._waiting is None
        recording = self._journal.plan_started(plan, view, notes, resumable=resumable)
        self.view = view.model_copy(update={"recording": recording})
        return self.view

    def look(self, seen: Observation) -> None:
        """Advance the plan by one observation and put what it demands into the set-point."""
        executor = self._executor
        if executor is None or not self.active:
            return
        if self.estimator is not None and self.estimator.precision is not None:
            seen = seen._replace(precision=self.estimator.precision)
        self._apply(executor.advance(seen))
        self._pass_on_points(executor)
        if (waiting := self._waiting) is not None and executor.state is PlanState.DONE:
            self._waiting = None
            self._journal.plan_checked(waiting.view, executor.message)
            self._begin(waiting.plan, waiting.view, waiting.notes, waiting.mesh)
            return
        if executor.finished:
            self._close(executor.progress())
        else:
            self._show(executor.progress())

    def _close(self, progress: dict[str, Any]) -> None:
        """Command nothing any more, and end the recording of a plan that ends with `progress`."""
        self.active, self._ended = False, progress
        if self.estimator is not None:
            self.estimator.end()
        self._setpoint.rest()
        self._setpoint.compensate = self._compensate_before
        if self.view is not None:
            self._journal.plan_closing(self._with(self.view, progress))
            step = {"state": PlanState.ENDING.value, "step": "closing the recording"}
            self.view = self._with(self.view, {**progress, **step})
        self.conclude()

    def conclude(self) -> None:
        """End a plan whose recording is closed, or is known not to be.

        One that was done has failed if it is not recorded in full.
        """
        why = self._journal.unrecorded() if self._ended is not None else None
        if self._ended is None or why is None:
            return
        progress, self._ended = self._ended, None
        if why and self.view is not None:
            said = [progress["message"]] if progress["message"] else []
            if self.view.recorded:  # else that is what it was ended for
                said.append(f"{why}; {RETAKE}")
            state = "failed" if progress["state"] == "done" else progress["state"]
            message = "; ".join(said)
            progress = {**progress, "state": state, "message": message, "recorded": False}
        self._show(progress)
        self._finish()

    def unrecorded(self, why: str) -> None:
        """Abort a plan whose points are not recorded."""
        if self.active and self.view is not None:
            self._journal.points_missing()
            self.view = self.view.model_copy(update={"recorded": False})
            self.abort(why)

    def pause(self) -> None:
        """Ramp to zero and wait."""
        if self._executor is not None and self.active:
            self._executor.pause()
            self._show(self._executor.progress())

    def resume(self) -> None:
        """Go on after a pause."""
        if self._executor is not None and self.active:
            self._executor.resume()
            self._show(self._executor.progress())

    def abort(self, why: str) -> None:
        """Ramp down, disable, end."""
        executor = self._executor
        if executor is None or not self.active or executor.over:
            return
        executor.abort(why)
        self._show(executor.progress())

    def end(self, why: str, state: Literal["aborted", "failed"] = "failed") -> None:
        """End at once: the bench is stopped, or no longer there for the plan to ramp down."""
        if self._executor is None or not self.active:
            return
        self._close({**self._executor.progress(), "state": state, "message": why, "eta_s": 0.0})

    def _pass_on_points(self, executor: Executor) -> None:
        new = [self._measured(point) for point in executor.points[self._points_passed_on :]]
        for point in new:
            self._journal.plan_point(point)
            if self.estimator is not None:
                self.estimator.captured(point)
        self._points_passed_on = len(executor.points)
        under_way = mesh.under_way(executor)
        if self.mesh is not None and (new or under_way != self._under_way):
            self._under_way = under_way
            self.mesh = mesh.with_under_way(mesh.with_captures(self.mesh, new), under_way)

    def _measured(self, point: Capture) -> Capture:
        """Return a captured point with its torque error, as far as that is measured."""
        errors = asdict(self._torque_error(int(point["index"])))
        return {**point, **{name: value for name, value in errors.items() if value is not None}}

    def _apply(self, demand: Demand) -> None:
        s = self._setpoint
        s.torque_Nm, s.speed_Hz = demand.torque_Nm, demand.speed_Hz or None
        s.brake, s.drive_Hz = demand.brake, demand.drive_rad_s / RAD_PER_TURN
        s.compensate, s.plan_point = Compensate(demand.compensate), demand.plan_point
        s.induced = demand.induced
        if demand.enabled != self._enabled:
            s.request(Request.ENABLE if demand.enabled else Request.DISABLE)
        self._enabled = demand.enabled

    def _show(self, progress: dict[str, Any]) -> None:
        if self.view is not None:
            self.view = self._with(self.view, progress)
            self._journal.plan_progress(self.view)

    def _with(self, view: PlanView, progress: dict[str, Any]) -> PlanView:
        """Return the view of a plan with this progress."""
        now = {**self._counted(progress), **self._precision()}
        if self._waiting is not None:
            now = self._waiting.shown(progress)
        return PlanView.model_validate({**view.model_dump(), **now})

    def _precision(self) -> dict[str, Any]:
        """Return the newest precision as it is shown, {} for none."""
        known = self.estimator.precision if self.estimator is not None else None
        if known is None:
            return {}
        return {"precision": dict(known.half_widths), "obstacle": known.obstacle}

    def _counted(self, progress: dict[str, Any]) -> dict[str, Any]:
        """Return progress with the points of the whole plan."""
        counts = {key: progress[key] + self._points_before for key in ("points", "points_done")}
        return {**progress, **counts}

    def _finish(self) -> None:
        if self.mesh is not None:
            self.mesh, self._under_way = mesh.with_under_way(self.mesh, None), None
        if self.view is not None:
            self._journal.plan_over(self.view)
