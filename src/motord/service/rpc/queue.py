"""RPCs of the queue of plans, and how it begins plans as operators do."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from motord.api import queue_requests as rpc
from motord.api.errors import RpcError
from motord.api.plan_messages import PlanView
from motord.api.queue_messages import QueuedPlan
from motord.api.requests import NoArguments, RpcRequest, parse
from motord.schema import State
from motord.service.bench.bench import Bench
from motord.service.plans.resume import Resumption
from motord.service.queue.attempt import BeginPlan, valueless
from motord.service.queue.plan_queue import PlanQueue
from motord.service.queue.runner import QueueRunner
from motord.service.rpc.dispatcher import RpcContext, Wait, handles
from motord.service.rpc.plans import PlanControl, PreparedPlan, estimate_s_of, same_serial
from motord.service.rpc.preconditions import loop_up, no_trip, not_ramping_down

DISK_S = 10.0


class QueuedPlanControl:
    """Begins plans for the queue: a `QueuedPlanStarter`."""

    def __init__(self, bench: Bench, plans: PlanControl, resumption: Resumption) -> None:
        self._bench = bench
        self._plans = plans
        self.run_of: Callable[[str], PlanView | None] = resumption.run_of

    def prepare_queued(self, plan: QueuedPlan, run_id: str, *, resume: bool) -> BeginPlan:
        """Return what begins a plan, or the rest of the run in the journal; for a thread.

        Raises RpcError, as does what is returned.
        """
        if resume:
            rest = self._plans.prepare_rest()
            return lambda holder, detached: self._plans.begin_rest(rest, holder, detached=detached)
        serial = plan.serial or ""
        same_serial(self._bench, serial)
        whole = self._plans.prepare(plan.name, plan.settings, check=plan.check)

        def begin(holder: str, detached: bool) -> None:
            self._plans.begin(
                whole, holder, plan.notes, detached=detached, serial=serial, run_id=run_id
            )

        return begin


@dataclass
class QueueOperation:
    """What clients ask of the queue."""

    bench: Bench
    plans: PlanControl
    resumption: Resumption
    runner: QueueRunner

    def prepare_add(self, payload: bytes) -> tuple[RpcRequest, list[PreparedPlan]]:
        """Return a request to add plans with each of them, within all limits; for a thread.

        Raises RpcError.
        """
        request, prepared = parse(rpc.QUEUE_ADD, payload), []
        for n, plan in enumerate(request.plans, 1):
            try:
                prepared.append(self.plans.prepare(plan.name, plan.settings, check=plan.check))
            except RpcError as error:
                raise _of_plan(n, plan, error) from None
        return request, prepared

    @handles(rpc.QUEUE_ADD)
    def add(self, request: rpc.QueueAdd, context: RpcContext) -> Wait[rpc.QueueContent]:
        """Add plans that this bench can run; replies once the disk holds them."""
        estimates = []
        for n, (plan, prepared) in enumerate(zip(request.plans, context.prepared, strict=True), 1):
            try:
                same_serial(self.bench, plan.serial or "")
                estimates.append((plan, estimate_s_of(self.bench, prepared)))
                for wait in plan.wait:
                    if wait.channel is not None and self.runner.value_of(wait.channel) is None:
                        raise RpcError("invalid", valueless(wait.channel))
            except RpcError as error:
                raise _of_plan(n, plan, error) from None
        queue = self.runner.queue.added(estimates, context.holder)
        added = [item.id for item in queue.items[-len(estimates) :]]
        return self._changed(queue, f"{_numbers(added)} added", context, added)

    @handles(rpc.QUEUE_MOVE)
    def move(self, request: rpc.QueueMove, context: RpcContext) -> Wait[rpc.QueueContent]:
        """Give an item another place."""
        queue = self.runner.queue.moved(request.id, request.position)
        return self._changed(queue, f"{request.id} moved to place {request.position}", context)

    @handles(rpc.QUEUE_REMOVE)
    def remove(self, request: rpc.QueueRemove, context: RpcContext) -> Wait[rpc.QueueContent]:
        """Take items out."""
        queue = self.runner.queue.without(request.ids)
        return self._changed(queue, f"{_numbers(request.ids)} removed", context)

    @handles(rpc.QUEUE_START, loop_up, no_trip)
    def start(self, request: rpc.QueueStart, context: RpcContext) -> rpc.QueueContent:
        """Run the plans, or go on after a pause."""
        bench, runner = self.bench, self.runner
        first = runner.queue.first
        if first is None:
            raise RpcError("refused", "the queue is empty; motord queue add")
        if runner.queue.running is None and bench.plans.active:
            raise RpcError("plan_running", "a plan that is not of the queue is under way")
        if not bench.queue.active and not bench.plans.active:
            not_ramping_down(bench)
            if bench.state is State.ENABLED:
                raise RpcError("refused", "disable the bench first: the queue may have to wait")
            bench.manual.rest()
        if self.resumption.interrupted and bench.plans.concluded:
            run = self.resumption.view()
            if run is not None and run.run_id != first.run_id:
                raise RpcError("refused", f"not started: {self.resumption.summary()}")
        runner.start(context.holder, detached=request.detach)
        return self._all()

    @handles(rpc.QUEUE_PAUSE)
    def pause(self, request: rpc.QueuePause, context: RpcContext) -> rpc.QueueContent:
        """Begin no further plan; with `now`, pause the one under way, too."""
        runner, why = self.runner, f"by {context.holder}"
        if request.now:
            if self.bench.plans.active and runner.queue.running is not None:
                self.bench.plans.pause()
            runner.pause(why)
        else:
            runner.pause_after_plan(why)
        return self._all()

    @handles(rpc.QUEUE_LIST)
    def list(self, request: NoArguments, context: RpcContext) -> rpc.QueueContent:
        """Return all of it."""
        return self._all()

    def _changed(
        self, queue: PlanQueue, what: str, context: RpcContext, added: Sequence[int] = ()
    ) -> Wait[rpc.QueueContent]:
        """Change the queue; the reply comes once the disk has it. What cannot be added is not."""
        runner = self.runner
        runner.change(queue)
        runner.show()
        self.bench.events.emit("queue", f"{what} by {context.holder}")

        def written() -> rpc.QueueContent | None:
            if not runner.file.idle:
                return None
            if not runner.file.error:
                return self._all(added)
            if added:
                if runner.queue.running is not None and runner.queue.running.id in added:
                    runner.pause(runner.file.error)  # it has not begun, nor will it
                still = {item.id for item in runner.queue.items} & set(added)
                runner.change(runner.queue.without(still))
                undone = f"nothing was added: {runner.file.error}"
                self.bench.events.emit("queue", undone)
                raise RpcError("failed", undone)
            raise RpcError("failed", f"{what}, but only until the daemon ends: {runner.file.error}")

        return Wait(written, DISK_S, lambda: f"{what}, but not on the disk in {DISK_S:g} s")

    def _all(self, added: Sequence[int] = ()) -> rpc.QueueContent:
        queue = self.runner.queue
        return rpc.QueueContent(
            queue=self.bench.queue, items=[*queue.items], history=[*queue.history], added=[*added]
        )


def _of_plan(number: int, plan: QueuedPlan, error: RpcError) -> RpcError:
    return RpcError(error.code, f"plan {number}, {plan.name}: {error.message}; nothing was added")


def _numbers(ids: list[int]) -> str:
    return ", ".join(map(str, ids))
