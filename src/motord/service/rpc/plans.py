"""RPCs of plans: start, pause, resume, abort, discard, list."""

from collections.abc import Callable
from typing import Any

from motord.api.errors import RpcError
from motord.api.requests import PlanResume, PlanStart, RpcRequest, WithToken, parse
from motord.config.experiments import plan_kinds
from motord.experiments.plans import build as build_plan
from motord.sequencing import Plan, PlanError
from motord.service.bench.bench import Bench
from motord.service.plans.resume import RemainingPlan, Resumption
from motord.service.plans.runner import EarlierPart
from motord.service.rpc.calls import Answer, Call
from motord.service.rpc.dispatcher import (
    Handler,
    expect,
    need_no_plan,
    need_ready,
    need_zero_torque,
)


class Experiments:
    """Starts plans, steers the one under way, resumes one that was interrupted."""

    def __init__(
        self, bench: Bench, resumption: Resumption, unrecordable: Callable[[], str] = str
    ) -> None:
        self._bench = bench
        self._resumption = resumption
        self._unrecordable = unrecordable
        self.handlers: dict[str, Handler] = {
            "plan/start": self._start,
            "plan/pause": self._pause,
            "plan/resume": self._resume,
            "plan/abort": self._abort,
            "plan/discard": self._discard,
            "plan/list": self._list,
        }

    def _start(self, call: Call, now_ns: int) -> Answer:
        asked, bench = expect(PlanStart, call), self._bench
        plan = self._build(asked)
        outline = _outline(plan)
        if asked.dry_run:
            return outline
        who = bench.lease.require(asked.token, now_ns).holder
        self._need_free_bench()
        if self._resumption.interrupted:
            raise RpcError("refused", f"not started: {self._resumption.summary()}")
        detached = ", detached" if asked.detach else ""
        bench.events.emit("plan", f"{plan.name} started by {who}{detached}", settings=plan.settings)
        bench.hand.rest()
        view = bench.plans.start(plan, who, asked.notes, detached=asked.detach)
        return {**outline, "recording": view.recording}

    def _build(self, asked: PlanStart) -> Plan:
        try:
            plan = build_plan(asked.name, self._bench.config, asked.settings)
        except PlanError as error:
            raise RpcError("invalid", str(error)) from None
        self._need_devices(plan)
        return plan

    def _need_devices(self, plan: Plan) -> None:
        if plan.needs and not self._bench.has(plan.needs):
            raise RpcError("refused", f"{plan.name} needs a {plan.needs}, and this bench has none")
        if plan.settings.get("compensate", "off") != "off" and not self._bench.calibrated:
            raise RpcError(
                "refused",
                f"{plan.name} compensates, but no calibration is installed; install one, or set "
                "compensate=off",
            )

    def _need_free_bench(self) -> None:
        bench = self._bench
        need_ready(bench)
        need_zero_torque(bench, "a plan begins with an open brake")
        if bench.trouble:
            raise RpcError("refused", f"not started: {bench.trouble}")
        if why := self._unrecordable():
            raise RpcError(
                "refused",
                f"not started: it could not be recorded: {why}; make it possible, or allow plans "
                "without a recording by [recording] required = false",
            )

    def _need_plan(self, call: Call, now_ns: int) -> str:
        who = self._bench.lease.require(expect(WithToken, call).token, now_ns).holder
        if not self._bench.plans.active:
            raise RpcError("refused", "no plan is under way")
        return who

    def _progress(self) -> Answer:
        view = self._bench.plans.view
        return view.model_dump(mode="json") if view is not None else {}

    def _pause(self, call: Call, now_ns: int) -> Answer:
        who = self._need_plan(call, now_ns)
        self._bench.events.emit("plan", f"paused by {who}")
        self._bench.plans.pause()
        return self._progress()

    def look_for_rest(self, payload: bytes) -> tuple[RpcRequest, RemainingPlan | None]:
        """Return a request to resume and what is missing of the plan; None if one is under way.

        For a thread that may wait, before `plan/resume`: it reads recordings. Raises RpcError.
        """
        request = parse("plan/resume", payload)
        return request, None if self._bench.plans.active else self._resumption.remaining()

    def _resume(self, call: Call, now_ns: int) -> Answer:
        asked, bench = expect(PlanResume, call), self._bench
        who = bench.lease.require(asked.token, now_ns).holder
        if bench.plans.active:
            bench.events.emit("plan", f"resumed by {who}")
            bench.plans.resume()
            return self._progress()
        rest: RemainingPlan | None = call.prepared
        if rest is None:  # to read its recordings here would hold up the heartbeat
            raise RpcError("busy", "the plan that was under way has just ended; ask again")
        if rest.plan.points:
            self._go_on(rest, who, detached=asked.detach)
        else:
            self._resumption.complete()
            bench.plans.show(self._resumption.view())
        return self._progress()

    def _go_on(self, rest: RemainingPlan, who: str, *, detached: bool) -> None:
        """Take what is missing of an interrupted plan."""
        self._need_free_bench()
        self._need_devices(rest.plan)
        note, bench = rest.log.plan, self._bench
        bench.events.emit(
            "plan",
            f"{note.name} resumed by {who}: {rest.taken} of {note.points} points are taken",
            run_id=note.run_id,
        )
        bench.hand.rest()
        before = EarlierPart(note.run_id, rest.log.recordings[-1], rest.taken)
        bench.plans.start(rest.plan, who, note.notes, detached=detached, before=before)

    def _discard(self, call: Call, now_ns: int) -> Answer:
        who = self._bench.lease.require(expect(WithToken, call).token, now_ns).holder
        need_no_plan(self._bench)
        name = self._resumption.discard()
        self._bench.events.emit("plan", f"{name} discarded by {who}: it cannot be resumed any more")
        self._bench.plans.show(None)
        return {"plan": name}

    def _abort(self, call: Call, now_ns: int) -> Answer:
        who = self._need_plan(call, now_ns)
        self._bench.plans.abort(f"aborted by {who}")
        return self._progress()

    def _list(self, call: Call, now_ns: int) -> Answer:
        own = self._bench.config.plans
        return {
            "plans": [
                {
                    "name": name,
                    "summary": kind.summary,
                    "settings": getattr(own, name.replace("-", "_")).model_dump(mode="json"),
                }
                for name, kind in plan_kinds().items()
            ]
        }


def _outline(plan: Plan) -> dict[str, Any]:
    """Return what a plan will do: points, estimated time, settings."""
    return {
        "plan": plan.name,
        "points": [
            {
                "index": p.index,
                "torque_Nm": p.torque_Nm,
                "speed_Hz": p.speed_Hz,
                "turns": p.turns,
                "aim": p.aim,
            }
            for p in plan.points
        ],
        "estimate_s": round(plan.seconds, 1),
        "settings": plan.settings,
    }
