"""Runs the plans of the queue one after the other, a step at a time.

The first item waits for its conditions, its plan is prepared in another thread, the disk holds the
number of its run, and then the plan begins: whatever dies when, the next daemon knows from queue
and journal whether the run had begun, can be resumed, or is done. What ends otherwise than done or
by a failure of the plan itself (trip, stop, abort, lost lease) pauses the queue; so does a daemon's
start.
"""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import partial
from uuid import uuid4

from motord.api.queue_messages import QueueItem, QueueRun, QueueView
from motord.schema import State
from motord.service.bench.bench import Bench
from motord.service.queue.attempt import (
    Attempt,
    BeginPlan,
    ChannelValue,
    NotStartedError,
    QueuedPlanStarter,
    WaitFailedError,
    Waits,
)
from motord.service.queue.plan_queue import PlanQueue
from motord.service.queue.queue_file import QueueFile

Submit = Callable[[Callable[[], BeginPlan]], "Future[BeginPlan]"]
"""Has something done by a thread that may wait."""


@dataclass
class QueueRunner:
    """The queue and where it stands; `bench.queue` shows it. `unix_ns`: the computer's own time."""

    bench: Bench
    plans: QueuedPlanStarter
    file: QueueFile
    value_of: ChannelValue
    unix_ns: Callable[[], int]
    submit: Submit
    queue: PlanQueue = field(default_factory=PlanQueue)
    _attempt: Attempt | None = None
    _waits: tuple[tuple[int, int], Waits] | None = None

    def __post_init__(self) -> None:
        self._active = self._pausing = self._detached = False
        self._holder = self._message = ""
        self._stops = self._done = self._failed = 0

    def load(self) -> None:
        """Take in what is on the disk; a run that was under way is done or interrupted."""
        self.queue, wrong = self.file.load()
        if wrong:
            self._event(wrong)
        item = self.queue.running
        if item is not None:
            run = self.plans.run_of(item.run_id)
            if run is None:
                self._event(f"{_name(item)} is run from its beginning: it left nothing to resume")
                self.change(self.queue.with_first(state="queued", run_id=""))
            else:
                self._ended(run.state, run.message, item.run_id, run.recording)
        if self.queue.items:
            self._message = "the daemon was started; motord queue start goes on"
            self._event(f"paused with {len(self.queue.items)} plans: {self._message}")
        self.show()

    def start(self, holder: str, *, detached: bool) -> None:
        """Begin with the first item, or go on; the caller has checked that this is possible."""
        plans, attempt = self.bench.plans, self._attempt
        self._stops = self.bench.stops
        self._detached = detached or (self._active and self._detached)
        if not self._active:
            self._holder = holder
            self._done = self._failed = 0
            self._event(f"started by {holder}{', detached' if detached else ''}")
            if self.queue.first is not None and attempt is None:
                self.change(self.queue.with_first(failures=0))
        self._active, self._pausing, self._message = True, False, ""
        if attempt is not None and plans.active and plans.view is not None:
            plans.view = plans.view.model_copy(update={"detached": self._detached})
            plans.resume()
        self.show()

    def pause(self, why: str) -> None:
        """Begin no further plan from now on; one that is under way goes on."""
        attempt = self._attempt
        if attempt is not None and not attempt.began_ns:
            self._withdraw(attempt)
        self._active = self._pausing = False
        self._waits, self._message = None, why
        self._event(f"paused: {why}")
        self.show()

    def pause_after_plan(self, why: str) -> None:
        """Begin no further plan; paused once the one under way has ended."""
        if self._attempt is None or not self._attempt.began_ns:
            self.pause(why)
        else:
            self._pausing, self._message = True, why
            self.show()

    def step(self, now_ns: int) -> None:
        """Do what is due at `now_ns` (monotonic)."""
        if self._active and (why := self._obstacle(now_ns)):
            self.pause(why)
        if self._attempt is not None:
            self._carry_on(self._attempt, now_ns)
        elif self._active:
            self._next(now_ns)
        self.show()

    def _obstacle(self, now_ns: int) -> str:
        """Return what keeps the queue from going on by itself, "" for nothing."""
        bench = self.bench
        if bench.stops != self._stops:
            return "the bench was stopped"
        if bench.state is State.TRIPPED:
            return f"the bench tripped: {bench.monitor.trip_summary()}"
        if bench.fault != bench.device_fault:
            return bench.fault
        if not self._detached and bench.lease.holder(now_ns) is None:
            return "nobody is in command any more"
        return ""

    def _next(self, now_ns: int) -> None:
        """Wait for the conditions of the first item, then prepare its plan."""
        item, unix_ns = self.queue.first, self.unix_ns()
        if item is None:
            self.pause("all plans have been run")
            return
        if not item.turn_ns:
            self.change(self.queue.with_first(turn_ns=unix_ns))
            item = self.queue.items[0]
        key = item.id, item.turn_ns
        if self._waits is None or self._waits[0] != key:
            self._waits = key, Waits(item.plan.wait, item.turn_ns)
        try:
            if not self._waits[1].over(now_ns, unix_ns, self.value_of):
                return
        except WaitFailedError as failed:
            self._ended("failed", str(failed))
            return
        known = self.plans.run_of(item.run_id) if item.run_id else None
        if known is not None and known.state == "done":  # resumed manually meanwhile
            self._ended("done", known.message, item.run_id, known.recording)
            return
        self._prepare(item, resume=known is not None)

    def _prepare(self, item: QueueItem, *, resume: bool) -> None:
        if item.run_id and not resume:
            self._event(f"{_name(item)} is run from its beginning: it left nothing to resume")
        run_id = item.run_id if resume else uuid4().hex
        work = partial(self.plans.prepare_queued, item.plan, run_id, resume=resume)
        self._attempt = Attempt(item, run_id, self.submit(work))
        self.queue = self.queue.with_first(state="running", run_id=run_id)

    def _carry_on(self, attempt: Attempt, now_ns: int) -> None:
        """Bring the run of the first item on its way, or follow it."""
        if attempt.began_ns:
            self._follow(attempt)
        elif not attempt.prepared.done():
            return
        elif not attempt.saved:
            attempt.saved = True
            self.change(self.queue)
        elif self.file.idle and now_ns >= attempt.again_ns:
            self._begin(attempt, now_ns)

    def _begin(self, attempt: Attempt, now_ns: int) -> None:
        name = _name(attempt.item)
        try:
            if self.file.error:
                raise NotStartedError(f"the queue cannot be written: {self.file.error}")
            refused = attempt.begin(self._holder, now_ns, detached=self._detached)
        except NotStartedError as error:  # the next one would not begin, either
            self.pause(f"{name} was not started: {error}")
            return
        if refused:
            self._message = f"{name} waits for its start: {refused}"
            return
        self._message = ""
        attempt.began_ns = self.unix_ns()
        self._follow(attempt)

    def _follow(self, attempt: Attempt) -> None:
        """Note how the plan has ended, if it has."""
        plans, view = self.bench.plans, self.bench.plans.view
        ours = view if view is not None and view.run_id == attempt.run_id else None
        if ours is not None and not plans.concluded:
            return
        run_id, began_ns = attempt.run_id, attempt.began_ns
        if ours is None or not ours.over:
            self._ended("aborted", "another plan was begun", run_id, began_ns=began_ns)
        else:
            self._ended(ours.state, ours.message, run_id, ours.recording, began_ns)

    def _withdraw(self, attempt: Attempt) -> None:
        """Put the first item back to what it was before."""
        before = attempt.item
        self._attempt = None
        self.change(self.queue.with_first(state=before.state, run_id=before.run_id))

    def _ended(
        self, state: str, message: str, run_id: str = "", recording: str = "", began_ns: int = 0
    ) -> None:
        """Note the end of a run of the first item; go on, or pause."""
        item = self.queue.items[0]
        run = QueueRun.model_validate(
            {
                "id": item.id, "plan": item.plan.name, "state": state, "message": message,
                "run_id": run_id, "recording": recording,
                "began_ns": began_ns, "ended_ns": self.unix_ns(),
            }
        )  # fmt: skip
        self._attempt = self._waits = None
        self.change(self.queue.ended(run, retry=self._active))
        first = self.queue.first
        kept = first is not None and first.id == item.id
        self._done += not kept
        self._failed += state == "failed"
        outcome = f"{_name(item)} {state}" + (f": {message}" if message else "")
        self._event(outcome + (", skipped" if state == "failed" and not kept else ""))
        if not self._active:
            return
        if kept and first is not None and first.state != "queued":
            self.pause(outcome)
        elif self._pausing:
            self.pause(self._message)

    def change(self, queue: PlanQueue) -> None:
        """Put an edited queue in the place of this one, and on the disk."""
        self.queue = queue
        self.file.save(queue)

    def _event(self, message: str) -> None:
        self.bench.events.emit("queue", message)

    def show(self) -> None:
        """Make what `bench.queue` shows, unless it is what was shown before."""
        queue, plans, running = self.queue, self.bench.plans, self.queue.running
        left_s = sum(item.estimate_s for item in queue.items)
        message = self._message
        if running is not None and not plans.concluded and plans.view is not None:
            left_s += plans.view.eta_s - running.estimate_s
        elif self._waits is not None and self._active and running is None:
            left_s += self._waits[1].left_s(self.unix_ns())
            message = self._waits[1].message
        waiting = self._active and running is None
        state = "pausing" if self._pausing else "waiting" if waiting else "running"
        after = queue.items[1:2] if running is not None else queue.items[:1]
        shown = {
            "state": state if self._active else "paused",
            "message": message,
            "length": len(queue.items),
            "running": running.id if running is not None else None,
            "next": after[0].id if after else None,
            "next_plan": after[0].plan.name if after else "",
            "done": self._done,
            "failed": self._failed,
            "eta_s": round(left_s, 1),
            "detached": self._detached and self._active,
        }
        if shown != vars(self.bench.queue):  # to make a view of it takes ten times as long
            self.bench.queue = QueueView.model_validate(shown)


def _name(item: QueueItem) -> str:
    return f"{item.id} ({item.plan.name})"
