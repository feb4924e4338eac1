"""The supervisor's core on a virtual bench: the real kernel and rig, time that only steps."""

import json
from concurrent.futures import Future
from functools import cache
from pathlib import Path

import numpy as np

from motord import config
from motord.api.errors import RpcError
from motord.api.requests import RPCS, parse
from motord.control.types import SETPOINT
from motord.rig import truth
from motord.service.bench.bench import Bench
from motord.service.host.events import EventLog
from motord.service.plans.journal_file import Journal
from motord.service.plans.resume import Resumption
from motord.service.queue.plan_queue import PlanQueue
from motord.service.queue.queue_file import QueueFile
from motord.service.queue.runner import QueueRunner
from motord.service.rpc.dispatcher import Call, Dispatcher
from motord.service.rpc.operation import ManualOperation
from motord.service.rpc.plan_list import AvailablePlans
from motord.service.rpc.plans import PlanControl
from motord.service.rpc.queue import QueuedPlanControl, QueueOperation
from motord.virtual import VirtualBench

STEP_NS = 10_000_000
START_NS = 1_000_000_000_000

packaged_bench = cache(config.load)
rig_of = cache(truth.load)
"""A file is read once: that takes half of the time in which a service is made."""


class RecordedSink:
    """A sink that keeps what it receives."""

    def __init__(self):
        self.started, self.points, self.progress, self.over = [], [], [], []
        self.missing = ""

    def plan_started(self, plan, view, notes):
        self.started.append((plan, view, notes))
        return f"/runs/{plan.name}.mcap"

    def plan_point(self, point):
        self.points.append(point)

    def plan_progress(self, view):
        self.progress.append(view)

    def plan_over(self, view):
        if len(self.over) < len(self.started):
            self.over.append(view)

    def plan_closing(self, view):
        self.plan_over(view)

    def unrecorded(self):
        return self.missing


class NoDisk:
    """What a journal writes to when nothing is to be kept."""

    error, size = "", 0

    def begin(self, line):
        pass

    def append(self, line):
        pass

    def remove(self):
        pass


def journal_in_memory():
    """A journal that is on no disk."""
    journal = Journal(Path("none"))
    journal._disk = NoDisk()
    return journal


class NoQueueFile(QueueFile):
    """The file of a queue that is on no disk."""

    def __init__(self):
        super().__init__(Path("none"))
        self.saved = None

    def load(self):
        return PlanQueue(), ""

    def save(self, queue):
        self.saved = queue


def done_at_once(work):
    """Do what a thread would do, now."""
    future = Future()
    try:
        future.set_result(work())
    except Exception as error:
        future.set_exception(error)
    return future


class VirtualLoop:
    """A mailbox, and the loop that reads it: `run` gives the ticks of the next 10 ms."""

    def __init__(self, bench_config, virtual=None):
        self.virtual = virtual or VirtualBench(bench_config, rig_of(bench_config.bench.rig))
        self.setpoint = np.zeros(1, SETPOINT)
        self.running = True
        self.last_torque_set_Nm = 0.0

    def write(self, setpoint):
        self.setpoint[:] = setpoint

    def run(self):
        if not self.running:
            return self.virtual.run(self.setpoint, 0)[0]
        rate_Hz = self.virtual.config.loop.rate_Hz
        ticks = self.virtual.run(self.setpoint, rate_Hz * STEP_NS // 1_000_000_000)[0]
        self.last_torque_set_Nm = float(ticks["torque_set_Nm"][-1])
        return ticks


class Pending:
    """A call under way."""

    def __init__(self, call):
        self.call = call

    @property
    def outcome(self):
        """The answer, the refusal, or None."""
        try:
            return self.call.wait(0).content()
        except RpcError as refusal:
            return None if refusal.code == "busy" else refusal


def fail(where, error):
    """Let a test fail by an error in the program, which the daemon would outlive."""
    raise error


class VirtualService:
    """Bench and dispatcher over a virtual loop; `devices` are slow devices on a wire.

    `virtual`: a bench with a rig and a calibration of its own.

    Errors in the program come out, unless it is to be as `safe` as the daemon.
    """

    def __init__(
        self, devices=None, bench_config=None, journal=None, safe=False, virtual=None,
        queue_file=None, **changes
    ):  # fmt: skip
        base = (bench_config or packaged_bench()).model_dump()
        for section, values in changes.items():
            base[section].update(values)
        self.config = config.Config.model_validate(base)
        self.now_ns, self.suspended_ns = START_NS, 0
        self.loop = VirtualLoop(self.config, virtual)
        self.events = EventLog(lambda: self.now_ns)
        self.sink = RecordedSink()
        self.journal = journal or journal_in_memory()
        self.calibration_id = ""
        self.resumption = Resumption(
            self.config, self.sink, self.journal, lambda: self.calibration_id, self.events,
            lambda: self.now_ns,
        )  # fmt: skip
        self.bench = Bench(self.config, self.loop, devices or {}, self.events, self.resumption)
        if not safe:
            self.bench.fault_stop = fail
        self.restarts = self.kills = 0
        self.recording_file = ""
        self.operation = ManualOperation(
            self.bench, self._restart, self._kill, lambda: self.recording_file
        )
        self.calibration_file = None
        self.plans = PlanControl(
            self.bench, self.resumption, calibration=lambda: self.calibration_file
        )
        self.available = AvailablePlans(self.bench)
        self.channels = {}
        self.queue = QueueRunner(
            self.bench, QueuedPlanControl(self.bench, self.plans, self.resumption),
            queue_file or NoQueueFile(), self.channels.get, lambda: self.now_ns, done_at_once,
        )  # fmt: skip
        self.queued = QueueOperation(self.bench, self.plans, self.resumption, self.queue)
        self.dispatcher = Dispatcher(
            *(self.bench, self.operation, self.available, self.plans, self.queued)
        )
        self.bench.loop.up()
        self.step(2)

    def _restart(self):
        self.restarts += 1
        self.bench.loop.up()

    def _kill(self):
        self.kills += 1

    def step(self, steps=1, lost=0):
        """Let `steps` times 10 ms pass; the disk takes none of it."""
        for _ in range(steps):
            self.now_ns += STEP_NS
            self.bench.step(self.loop.run(), lost, self.now_ns, self.suspended_ns)
            self.queue.step(self.now_ns)
            self.dispatcher.step(self.now_ns)
            self.bench.plans.conclude()
            self.journal.settle()
            self.queue.file.settle()

    def run_s(self, seconds, token=None):
        """Let `seconds` pass, with the lease renewed if `token` is given."""
        for _ in range(round(seconds * 1e9 / STEP_NS)):
            if token:
                self.bench.lease.renew(token, self.now_ns)
            self.step()

    def begin(self, name, /, **arguments):
        """Bring a request, and return it as it waits."""
        call = self.prepare(name, **arguments)
        self.dispatcher.handle(call, self.now_ns)
        return Pending(call)

    def carry_out(self, call):
        """Return the answer to a call that was prepared before; raises RpcError."""
        self.dispatcher.handle(call, self.now_ns)
        return self._answer(Pending(call))

    def prepare(self, name, /, **arguments):
        """Return the call that threads of the intake make of a request."""
        payload, prepared = json.dumps(arguments).encode(), None
        if name == "plan/resume":  # a thread of the intake reads the recordings
            _, prepared = self.plans.read_remaining(payload)
        if name == "plan/start":
            _, prepared = self.plans.make(payload)
        if name == "queue/add":
            _, prepared = self.queued.prepare_add(payload)
        if name == "plan/list":
            _, prepared = self.available.prepare(payload)
        return Call(name, parse(RPCS[name], payload), prepared)

    def ask(self, name, /, **arguments):
        """Return the answer to a request, let as much time pass as it takes; raises RpcError."""
        return self._answer(self.begin(name, **arguments))

    def _answer(self, pending):
        for _ in range(500):
            outcome = pending.outcome
            if outcome is not None:
                break
            self.step()
        if isinstance(outcome, RpcError):
            raise outcome
        return outcome

    def acquire(self, holder="anna", force=False):
        """Return a token."""
        return self.ask("lease/acquire", holder=holder, force=force)["token"]

    def enabled(self):
        """Return the token of a commander who has enabled the bench."""
        token = self.acquire()
        self.ask("enable", token=token)
        return token

    def ready(self):
        """Return the token of a commander who has enabled the bench and disabled it again."""
        token = self.enabled()
        self.ask("disable", token=token)
        return token

    def kinds(self):
        """Return the kinds of all events."""
        return [event.kind for event in self.events.recent()]

    def messages(self):
        """Return the messages of all events."""
        return [f"{event.kind}: {event.message}" for event in self.events.recent()]
