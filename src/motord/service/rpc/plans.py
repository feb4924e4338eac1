"""RPCs of plans: start, pause, resume, abort, discard."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from motord.api import requests as rpc
from motord.api.errors import RpcError
from motord.api.plan_messages import PlanView
from motord.api.replies import PlanName, PlanOutline, PlanProgress
from motord.experiments.check_calibration.plan import NAME, check_before, is_checked_before
from motord.experiments.plans import build as build_plan
from motord.sequencing import Plan, PlanError
from motord.service.bench.bench import Bench
from motord.service.plans.resume import RemainingPlan, Resumption
from motord.service.rpc.dispatcher import RpcContext, handles
from motord.service.rpc.preconditions import (
    can_be_enabled,
    no_plan,
    no_queue,
    not_ramping_down,
    plan_active,
    plan_devices,
    plan_goes_on,
    recording_closed,
    zero_torque,
)


@dataclass(frozen=True)
class PreparedPlan:
    """A plan, or what remains of one, and how often the bench had been stopped when asked for.

    check: the check of a calibration that comes before it, if there is to be one, and its file.
    """

    plan: Plan
    stops: int
    remaining: RemainingPlan | None = None
    check: Plan | None = None
    file: Path | None = None


@dataclass
class PlanControl:
    """Starts, pauses, aborts and resumes plans; `unrecordable` says why one cannot be recorded.

    calibration: returns the file of the calibration in force, None while there is none.
    """

    bench: Bench
    resumption: Resumption
    unrecordable: Callable[[], str] = str
    calibration: Callable[[], Path | None] = lambda: None

    @handles(rpc.PLAN_START)
    def start(self, request: rpc.PlanStart, context: RpcContext) -> PlanOutline:
        """Check a plan, and start it unless it is a dry run, which needs no lease."""
        bench, prepared = self.bench, context.prepared
        same_serial(bench, request.serial)
        estimate_s_of(bench, prepared)
        if request.dry_run:
            return outline_of(bench, prepared)
        holder = bench.lease.require(request.token, context.now_ns).holder
        no_queue(bench)
        view = self.begin(
            prepared, holder, request.notes, detached=request.detach, serial=request.serial
        )
        shown = {"recording": view.recording, "run_id": view.run_id}
        return outline_of(bench, prepared).model_copy(update=shown)

    def begin(
        self,
        prepared: PreparedPlan,
        holder: str,
        notes: str,
        *,
        detached: bool,
        serial: str = "",
        run_id: str = "",
    ) -> PlanView:
        """Begin a plan. Raises RpcError if bench, recorder or journal are not ready for one."""
        bench, plan = self.bench, prepared.plan
        self._check_startable(plan)
        self._not_stopped_since(prepared)
        if prepared.check is not None and prepared.file != self.calibration():
            why = "not started: another calibration was installed meanwhile; ask again"
            raise RpcError("refused", why)
        if self.resumption.interrupted:
            raise RpcError("refused", f"not started: {self.resumption.summary()}")
        apart = ", detached" if detached else ""
        checked = ", after a check of the calibration" if prepared.check is not None else ""
        message = f"{plan.name} started by {holder}{apart}{checked}"
        bench.events.emit("plan", message, settings=plan.settings)
        bench.manual.rest()
        return bench.plans.start(
            plan, holder, notes,
            detached=detached, serial=serial, check=prepared.check, run_id=run_id,
        )  # fmt: skip

    def _not_stopped_since(self, prepared: PreparedPlan) -> None:
        """Refuse what was asked for before the bench was stopped. Raises RpcError."""
        if prepared.stops != self.bench.stops:
            raise RpcError("refused", "not started: the bench was stopped meanwhile; ask again")

    def make(self, payload: bytes) -> tuple[rpc.RpcRequest, PreparedPlan]:
        """Return a request to start with its plan, which may take a while; for any thread.

        Raises RpcError.
        """
        request = rpc.parse(rpc.PLAN_START, payload)
        return request, self.prepare(request.name, request.settings, check=request.check)

    def prepare(self, name: str, settings: dict[str, Any], *, check: bool) -> PreparedPlan:
        """Return a plan within all limits, with the check before it; for any thread.

        Raises RpcError.
        """
        stops = self.bench.stops
        try:
            plan = build_plan(name, self.bench.config, settings)
        except PlanError as error:
            raise RpcError("invalid", str(error)) from None
        _ = plan.seconds, plan.points_digest  # kept by it: of many points they take long
        file = self._checked_before(plan) if check else None
        if file is None:
            return PreparedPlan(plan, stops)
        try:
            before = check_before(build_plan(NAME, self.bench.config), file)
        except PlanError as error:
            why = f"the check of the calibration before it (`--no-check` leaves it out): {error}"
            raise RpcError("invalid", why) from None
        return PreparedPlan(plan, stops, check=before, file=file)

    def _checked_before(self, plan: Plan) -> Path | None:
        """Return the calibration that the bench file wants checked before a plan. Raises RpcError.

        None if there is no calibration: a plan that needs one is refused for that.
        """
        bench = self.bench
        asked = bench.config.calibration.check_before_plans and is_checked_before(plan)
        if not asked or not bench.calibrated:
            return None
        file = self.calibration()
        if file is None:
            raise RpcError(
                "refused",
                "not started: the calibration in force is not on the disk, or not yet: it cannot "
                "be checked before; ask again, install it again, or start without the check",
            )
        return file

    def _check_startable(self, plan: Plan) -> None:
        bench = self.bench
        can_be_enabled(bench)
        recording_closed(bench)
        not_ramping_down(bench)
        zero_torque(bench, "a plan begins with an open brake")
        if fault := bench.drive_fault if plan.needs == "drive" else bench.device_fault:
            raise RpcError("refused", f"not started: {fault}")
        if why := self.unrecordable():
            raise RpcError(
                "refused",
                f"not started: it could not be recorded: {why}; make it possible, or allow plans "
                "without a recording by [recording] required = false",
            )

    @handles(rpc.PLAN_PAUSE, plan_goes_on)
    def pause(self, request: rpc.WithToken, context: RpcContext) -> PlanProgress:
        """Ramp to zero and wait."""
        self.bench.events.emit("plan", f"paused by {context.holder}")
        self.bench.plans.pause()
        return self._progress()

    @handles(rpc.PLAN_ABORT, plan_active)
    def abort(self, request: rpc.WithToken, context: RpcContext) -> PlanProgress:
        """Ramp down, disable, end."""
        self.bench.plans.abort(f"aborted by {context.holder}")
        return self._progress()

    def read_remaining(self, payload: bytes) -> tuple[rpc.RpcRequest, PreparedPlan | None]:
        """Return a request to resume and what remains of the plan; None if one is under way.

        For a thread that may wait, before `resume`: it reads recordings. Raises RpcError.
        """
        request = rpc.parse(rpc.PLAN_RESUME, payload)
        return request, self.prepare_rest() if self.bench.plans.concluded else None

    def prepare_rest(self) -> PreparedPlan:
        """Return what remains of the plan in the journal; for a thread. Raises RpcError."""
        stops, remaining = self.bench.stops, self.resumption.remaining()
        return PreparedPlan(remaining.plan, stops, remaining)

    @handles(rpc.PLAN_RESUME)
    def resume(self, request: rpc.PlanResume, context: RpcContext) -> PlanProgress:
        """Go on after a pause, or with what remains of a plan that was interrupted."""
        bench = self.bench
        if not bench.plans.concluded:
            plan_goes_on(bench)
            bench.events.emit("plan", f"resumed by {context.holder}")
            bench.plans.resume()
            return self._progress()
        no_queue(bench)
        if context.prepared is None:  # not read here: it takes long
            raise RpcError("busy", "the plan that was under way has just ended; ask again")
        self.begin_rest(context.prepared, context.holder, detached=request.detach)
        return self._progress()

    def begin_rest(self, prepared: PreparedPlan, holder: str, *, detached: bool) -> None:
        """Go on with what remains of a plan, which may be nothing. Raises RpcError."""
        remaining = prepared.remaining
        assert remaining is not None
        if remaining.log is not self.resumption.journal.log:
            why = "the plan was discarded or resumed meanwhile; ask again"
            raise RpcError("refused", f"not started: {why}")
        recording_closed(self.bench)
        self._not_stopped_since(prepared)
        if remaining.plan.points:
            self._start_remaining(remaining, holder, detached=detached)
        else:
            self.resumption.complete()
            self.bench.plans.show(self.resumption.view(), remaining.mesh)

    def _start_remaining(self, remaining: RemainingPlan, holder: str, *, detached: bool) -> None:
        self._check_startable(remaining.plan)
        plan_devices(self.bench, remaining.plan)
        note, bench = remaining.log.plan, self.bench
        bench.events.emit(
            "plan",
            f"{note.name} resumed by {holder}: {remaining.taken} of {note.points} points are taken",
            run_id=note.run_id,
        )
        bench.manual.rest()
        bench.plans.start(
            remaining.plan, holder, note.notes,
            detached=detached, serial=note.serial, before=remaining,
        )  # fmt: skip

    @handles(rpc.PLAN_DISCARD, no_plan, recording_closed, no_queue)
    def discard(self, request: rpc.WithToken, context: RpcContext) -> PlanName:
        """Forget a plan that was interrupted."""
        name = self.resumption.discard()
        message = f"{name} discarded by {context.holder}: it cannot be resumed any more"
        self.bench.events.emit("plan", message)
        self.bench.plans.show(None, None)
        return PlanName(plan=name)

    def _progress(self) -> PlanProgress:
        view = self.bench.plans.view
        assert view is not None
        return PlanProgress.model_validate(view.model_dump(mode="json"))


def same_serial(bench: Bench, serial: str) -> None:
    """Raise RpcError if the bench file names the serial number of another motor."""
    known = bench.config.motor.serial
    if serial and known not in ("", serial):
        why = f"[motor] serial of the bench file is {known!r}, not {serial!r}"
        raise RpcError("refused", why)


_POINT_FIELDS = ("index", "torque_Nm", "speed_Hz", "turns", "aim")


def estimate_s_of(bench: Bench, prepared: PreparedPlan) -> float:
    """Return how long a plan will take.

    Raises RpcError if the bench has not the devices, or not the calibration, that it needs.
    """
    plans = [one for one in (prepared.check, prepared.plan) if one is not None]
    for one in plans:
        plan_devices(bench, one)
    seconds = sum(one.seconds for one in plans)
    if not math.isfinite(seconds):
        raise RpcError("invalid", f"{prepared.plan.name}: would not end with these settings")
    return round(seconds, 1)


def outline_of(bench: Bench, prepared: PreparedPlan) -> PlanOutline:
    """Return what a plan will do: points, estimated time, settings.

    Raises RpcError if the bench has not the devices, or not the calibration, that it needs.
    """
    plan, check, estimate_s = prepared.plan, prepared.check, estimate_s_of(bench, prepared)
    checked = f"the calibration is checked first, about {check.seconds:.0f} s" if check else ""
    return PlanOutline(
        plan=plan.name,
        points=[{name: getattr(point, name) for name in _POINT_FIELDS} for point in plan.points],
        estimate_s=estimate_s,
        settings=plan.settings,
        outlook="; ".join(filter(None, (checked, plan.outlook))),
    )
