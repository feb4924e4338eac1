"""The queue under edits, ends of plans, kills and restarts: nothing is lost, nothing runs twice."""

from collections import Counter
from concurrent.futures import Future
from types import SimpleNamespace

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from motord.api.errors import RpcError
from motord.api.plan_messages import PlanView
from motord.api.queue_messages import QueuedPlan, QueueView
from motord.schema import State
from motord.service.queue.plan_queue import PlanQueue
from motord.service.queue.queue_file import QueueFile
from motord.service.queue.runner import QueueRunner
from tests.support.properties import examples

POLICIES = st.sampled_from(["stop", "skip", "retry"])


class PlayedDisk:
    """What a kill leaves of the queue's file and of the journal: what was flushed."""

    def __init__(self):
        self.queue, self.journal = PlanQueue().model_dump_json(), None


class PlayedFile(QueueFile):
    """A file whose thread writes when the test says so."""

    def __init__(self, disk):
        self.disk, self.newest, self.error = disk, None, ""

    @property
    def idle(self):
        return self.newest is None

    def load(self):
        return PlanQueue.model_validate_json(self.disk.queue), ""

    def save(self, queue):
        self.newest = queue.model_dump_json()

    def flush(self):
        self.disk.queue, self.newest = self.newest or self.disk.queue, None


class PlayedPlans:
    """The plans of a bench: `view` of the newest, and which runs began from their beginning."""

    def __init__(self, disk):
        self.disk = disk
        self.view = PlanView(**disk.journal) if disk.journal else None
        self.active, self.refused = False, False
        self.begun = []

    @property
    def concluded(self):
        return not self.active

    def run_of(self, run_id):
        return self.view if self.view and self.view.run_id == run_id else None

    def prepare_queued(self, plan, run_id, *, resume):
        def begin(holder, detached):
            assert not self.active
            if self.refused:
                raise RpcError("refused", "not now")
            assert run_id in self.disk.queue
            assert not resume or self.view.state != "done"
            if not resume:
                self.begun.append(plan.name)
            self.view, self.active = PlanView(plan=plan.name, state="running", run_id=run_id), True

        return begin

    def end(self, state):
        self.view, self.active = self.view.model_copy(update={"state": state}), False

    def resume(self):
        self.view = self.view.model_copy(update={"state": "running"})


class QueueMachine(RuleBasedStateMachine):
    def __init__(self):
        super().__init__()
        self.disk, self.now_ns = PlayedDisk(), 0
        self.begun, self.anew, self.left = Counter(), Counter(), Counter()
        self.order, self.order_on_disk = [], []
        self.names, self.done = 0, set()
        self.boot()

    def boot(self):
        self.file, self.plans = PlayedFile(self.disk), PlayedPlans(self.disk)
        if self.plans.view is not None and not self.plans.view.over:
            self.plans.view = self.plans.view.model_copy(update={"state": "interrupted"})
        self.bench = SimpleNamespace(
            stops=0, state=State.OFF, fault="", device_fault="", plans=self.plans,
            queue=QueueView(),
            lease=SimpleNamespace(holder=lambda now_ns: None),
            events=SimpleNamespace(emit=self.note_event),
            monitor=SimpleNamespace(trip_summary=lambda: "OVER_SPEED"),
        )  # fmt: skip
        self.runner = QueueRunner(
            self.bench, self.plans, self.file, {}.get, lambda: self.now_ns, self.submit
        )
        self.runner.load()
        assert self.bench.queue.state == "paused"
        self.follow()

    def submit(self, work):
        self.work = Future(), work
        return self.work[0]

    def note_event(self, kind, message):
        if "is run from its beginning" in message:
            self.anew[message.split("(")[1].split(")")[0]] += 1

    def follow(self):
        """Take note of what has begun and of what has left the queue."""
        self.begun.update(self.plans.begun)
        self.plans.begun.clear()
        names = [item.plan.name for item in self.runner.queue.items]
        gone = [name for name in self.order if name not in names]
        runs = {run.plan: run for run in self.runner.queue.history if not run.kept}
        for name in gone:
            assert runs[name].state == ("done" if name in self.done else "failed")
        self.order = [name for name in self.order if name not in gone]

    def steps(self, count=3, seconds=1.1):
        for _ in range(count):
            self.now_ns += round(seconds * 1e9)
            self.runner.step(self.now_ns)
            self.follow()

    @initialize(policies=st.lists(POLICIES, min_size=3, max_size=5))
    def begin(self, policies):
        self.add(policies)
        self.file.flush()
        self.order_on_disk = [*self.order]

    @rule(policies=st.lists(POLICIES, min_size=1, max_size=3))
    def add_more(self, policies):
        self.add(policies)

    def add(self, policies):
        plans = []
        for policy in policies:
            self.names += 1
            plans.append((QueuedPlan(name=f"p{self.names}", on_failure=policy), 1.0))
        self.runner.change(self.runner.queue.added(plans, "anna"))
        self.order += [plan.name for plan, _ in plans]

    @precondition(lambda self: self.order)
    @rule(index=st.integers(0, 5), position=st.integers(1, 6))
    def move(self, index, position):
        queue = self.runner.queue
        item = queue.items[index % len(queue.items)]
        try:
            self.runner.change(queue.moved(item.id, position))
        except RpcError:
            assert item == queue.running
            return
        fixed = 1 if queue.running else 0
        self.order.remove(item.plan.name)
        self.order.insert(fixed + position - 1, item.plan.name)

    @precondition(lambda self: self.order)
    @rule(index=st.integers(0, 5))
    def remove(self, index):
        queue = self.runner.queue
        item = queue.items[index % len(queue.items)]
        try:
            self.runner.change(queue.without([item.id]))
        except RpcError:
            assert item == queue.running
            return
        self.order.remove(item.plan.name)

    @precondition(lambda self: self.order)
    @rule(through=st.sampled_from([True, True, False]))
    def start(self, through):
        self.bench.state = State.OFF
        self.runner.start("anna", detached=True)
        self.steps()
        if through:
            self.go_on(refused=False)

    @rule(refused=st.booleans())
    def go_on(self, refused):
        """Whatever threads have to do is done."""
        self.plans.refused = refused
        for _ in range(3):
            if getattr(self, "work", None):
                (future, work), self.work = self.work, None
                future.set_result(work())
            self.file.flush()
            self.order_on_disk = [*self.order]
            self.steps(2, 1.1)

    @precondition(lambda self: self.plans.active)
    @rule(state=st.sampled_from(["done", "failed", "aborted"]), noted=st.booleans())
    def plan_ends(self, state, noted):
        [item, *_], active = self.runner.queue.items, self.bench.queue.active
        goes_on = self.bench.queue.state == "running"
        self.plans.end(state)
        if state == "done":
            self.done.add(item.plan.name)
        else:  # the end of an earlier run died with a daemon
            self.done.discard(item.plan.name)
        if noted:
            self.disk.journal = self.plans.view.model_dump()
        self.steps()
        if state == "done" or (state == "failed" and item.plan.on_failure == "skip" and active):
            assert item.plan.name not in self.order
        else:
            assert self.order[0] == item.plan.name
            again = item.plan.on_failure == "retry" and item.failures < item.plan.retries
            goes_on &= again and state == "failed"
        assert self.bench.queue.active == (goes_on and bool(self.order))

    @precondition(lambda self: self.order and not self.plans.active)
    @rule(state=st.sampled_from(["done", "failed"]), noted=st.booleans())
    def run(self, state, noted):
        if not self.bench.queue.active:
            self.start(through=True)
        self.go_on(refused=False)
        if self.plans.active:
            self.plan_ends(state, noted)

    @precondition(lambda self: self.plans.active)
    @rule()
    def journal_is_written(self):
        self.disk.journal = self.plans.view.model_dump()

    @rule(now=st.booleans())
    def pause(self, now):
        if now:
            self.runner.pause("by ben")
        else:
            self.runner.pause_after_plan("by ben")

    @precondition(lambda self: self.plans.active or self.bench.queue.active)
    @rule(how=st.sampled_from(["stop", "trip"]))
    def disturb(self, how):
        if how == "stop":
            self.bench.stops += 1
        else:
            self.bench.state = State.TRIPPED
        running = self.runner.queue.running
        if self.plans.active:
            self.plans.end("aborted" if how == "stop" else "failed")
        before = Counter(self.begun)
        self.steps()
        assert self.bench.queue.state == "paused"
        if running is not None and how == "trip":
            assert self.order[0] == running.plan.name
        self.go_on(refused=False)
        assert self.begun == before

    @precondition(lambda self: not self.plans.active)
    @rule()
    def somebody_else_uses_the_bench(self):
        if self.bench.queue.state == "paused":
            self.plans.view = PlanView(plan="theirs", state="done", run_id="theirs")
            self.disk.journal = self.plans.view.model_dump()

    @precondition(lambda self: self.order and not self.plans.active)
    @rule()
    def the_first_is_resumed_by_hand(self):
        first = self.runner.queue.first
        if self.bench.queue.state == "paused" and self.plans.run_of(first.run_id) is not None:
            self.plans.view = self.plans.view.model_copy(update={"state": "done"})
            self.disk.journal = self.plans.view.model_dump()
            self.done.add(first.plan.name)
            self.start(through=False)
            assert first.plan.name not in self.order

    @rule(now=st.sampled_from([True, False, False]))
    def kill(self, now):
        """The daemon dies; what was not on the disk is gone with it."""
        if not now:
            return
        self.work = None
        self.order = [*self.order_on_disk]
        self.boot()

    @invariant()
    def nothing_is_lost_and_order_is_kept(self):
        names = [item.plan.name for item in self.runner.queue.items]
        assert names == self.order
        left = Counter(run.plan for run in self.runner.queue.history if not run.kept)
        assert max(left.values(), default=0) <= 1
        assert not left.keys() & set(names)

    @invariant()
    def nothing_runs_twice_without_being_said(self):
        for name, count in self.begun.items():
            assert count <= 1 + self.anew[name], name

    @invariant()
    def only_the_first_runs(self):
        if self.plans.active:
            assert self.runner.queue.items[0].plan.name == self.plans.view.plan


TestQueue = QueueMachine.TestCase
TestQueue.settings = settings(max_examples=examples(100), stateful_step_count=30, deadline=None)
