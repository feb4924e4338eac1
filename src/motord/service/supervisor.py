"""The supervisor's loop: about a hundred times a second, and never waiting for anyone.

Ticks in, requests carried out, the bench advanced, the heartbeat written; everything that could
take long (devices, the network, the disk) happens in other threads or processes. Of the parts only
the bench may end the daemon by an error; the others are in the table of `service.bench.guard`.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from motord.schema import Request
from motord.schema import State as DriveState
from motord.service.bench.bench import Bench
from motord.service.bench.blackbox import BlackBoxTrigger
from motord.service.bench.guard import Guard
from motord.service.channels.link import ChannelLink
from motord.service.estimator.link import EstimatorLink
from motord.service.gateway.link import GatewayLink
from motord.service.host.children import NOT_ENDED, Children, Ended
from motord.service.host.log import log_error
from motord.service.host.loop_link import LOOP, LoopLink
from motord.service.host.systemd import Notifier
from motord.service.publish.publisher import Publisher
from motord.service.queue.runner import QueueRunner
from motord.service.recording.control import RecordingControl
from motord.service.rpc.dispatcher import Dispatcher
from motord.service.tracker.link import TrackerLink
from motord.shm.tables import TablesWriter
from motord.unix_clock import suspended_ns

PERIOD_NS = 10_000_000
EARLY_NS = 1_000_000
"""Between two steps requests are carried out as they come, so long apart."""
SHUTTING_DOWN = "the daemon is shutting down"
RAMP_MARGIN_S = 1.0
STOP_NS = 300_000_000
CLOSED_NS = 2_000_000_000
"""Time for the recording of a plan to be closed before the daemon ends; the bench is OFF."""
RECORDER_START_NS = 20_000_000_000


@dataclass
class Supervisor:
    """What gets its turn in every step, and in which order. `gateway`: None without TLS.

    `channels`: None without any; `tracker`: None unless it is enabled.
    """

    bench: Bench
    queue: QueueRunner
    dispatcher: Dispatcher
    children: Children
    loop: LoopLink
    tables: TablesWriter
    recording: RecordingControl
    boxes: BlackBoxTrigger
    publisher: Publisher
    channels: ChannelLink | None
    estimator: EstimatorLink
    tracker: TrackerLink | None
    gateway: GatewayLink | None
    guard: Guard
    notifier: Notifier
    clock_ns: Callable[[], int] = time.monotonic_ns
    suspended_ns: Callable[[], int] = suspended_ns

    def __post_init__(self) -> None:
        links = {"channels": self.channels, "estimator": self.estimator, "tracker": self.tracker}
        self._helpers = {name: link for name, link in links.items() if link is not None}

    def start(self) -> None:
        """Start the child processes; `take_down` ends them."""
        self.children.start_all(self.clock_ns())
        self.loop.start(self.clock_ns())

    def step(self) -> None:
        """Do everything that is due now."""
        now_ns, part = self.clock_ns(), self.guard.part
        with part("loop link", now_ns):
            if self.loop.follow():
                self.bench.loop.up()
        ended: list[Ended] = []
        with part("processes", now_ns):
            ended = self.children.poll(now_ns)
        block, lost = self.loop.read()  # after that: all there is of a loop that has ended
        with part("recording", now_ns):
            self.recording.take_ticks(block)
        with part("requests", now_ns):
            self.dispatcher.take(now_ns)
        for name, link in self._helpers.items():
            with part(name, now_ns):
                link.step(now_ns)
        self.bench.step(block, lost, now_ns, self.suspended_ns())
        for end in ended:  # by now its last ticks were taken in, trips among them
            with part("processes", now_ns):
                self._process_ended(end)
        with part("queue", now_ns):
            self.queue.step(now_ns)
        with part("answers", now_ns):
            self.dispatcher.step(now_ns)
        with part("gateway", now_ns):
            if self.gateway is not None:
                self.gateway.step(now_ns)
        with part("recording", now_ns):
            self.recording.step(now_ns)
            self.bench.plans.conclude()
        with part("publisher", now_ns):
            self.publisher.step(block, now_ns)
        with part("service manager", now_ns):
            self.notifier.progress(self.bench.monitor.ticks, now_ns)

    def _process_ended(self, end: Ended) -> None:
        """Report a process that has ended; the loop's end is a fault of the bench."""
        name, bench = end.process.name, self.bench
        if name != LOOP:
            again = f"; again in {end.again_s:g} s" if end.again_s is not None else ""
            bench.events.emit("process", f"{name} ended: {end.how}: {end.process.loss}{again}")
            return
        why = self.loop.ended(end)
        self.boxes.loop_died(why, bench.monitor)
        self.recording.loop_down()
        self.tables.forget_loop()
        bench.loop_down(why)
        self.recording.end(why)

    def wait_for_loop(self, stopping: Callable[[], object]) -> bool:
        """Step until the loop is up and recorded (True), or has failed or is to stop (False)."""
        self.run_until(lambda: stopping() or self.loop.phase != "starting")
        if self.loop.phase != "up":
            return False
        self.run_until(lambda: stopping() or self.recording.settled, RECORDER_START_NS)
        return not stopping()

    def ramp_down(self, why: str) -> None:
        """Ramp the torque to zero, disable, go OFF; whatever takes too long is cut short.

        Then, with no more requests, wait for the recording of a plan that has ended by this, if the
        bench is OFF.
        """
        bench, limits = self.bench, self.bench.config.limits
        bench.events.emit("daemon", f"shutting down: {why}")
        if bench.queue.active:
            self.queue.pause("the daemon shuts down")
        bench.plans.abort("the daemon shuts down")
        bench.disable()
        ramp_s = limits.torque_Nm / limits.ramp_down_Nm_per_s + RAMP_MARGIN_S
        self.run_until(lambda: bench.state is not DriveState.ENABLED, round(ramp_s * 1e9))
        bench.stop("the daemon shut down")
        over = (DriveState.OFF, DriveState.TRIPPED)
        self.run_until(lambda: bench.state in over, STOP_NS)
        self.dispatcher.close(SHUTTING_DOWN)
        if bench.state in over:
            self.run_until(lambda: bench.plans.concluded, CLOSED_NS)

    def emergency(self, error: BaseException) -> str:
        """Take the current away at once after an error in the program; return it in a line.

        The daemon ends with it: the state that it left the supervisor in is unknown. So nothing is
        used here but the mailbox and the ring.
        """
        setpoint = self.bench.setpoint
        setpoint.request(Request.STOP)
        end_ns = self.clock_ns() + STOP_NS
        seen_seq, state = 0, self.bench.monitor.state
        while self.clock_ns() < end_ns:
            setpoint.write(self.clock_ns(), seen_seq)
            block, _ = self.loop.read()
            if len(block):
                seen_seq = int(block["setpoint_seq"][-1])
                state = DriveState(int(block["state"][-1]))
            if state in (DriveState.OFF, DriveState.TRIPPED):
                break
            time.sleep(PERIOD_NS / 1e9)
        line = log_error("in the supervisor", error)
        with suppress(Exception):  # a listener may be what failed
            self.bench.events.emit("fault", f"{line}; stopped, the daemon ends")
        return line

    def take_down(self) -> None:
        """Take no more requests, end the loop, then the recorder, which by then has everything."""
        self.dispatcher.close(SHUTTING_DOWN)
        if self.gateway is not None:
            self.gateway.stop(self.clock_ns())
        for link in self._helpers.values():
            link.stop()
        self.children.stop(LOOP)
        block, _ = self.loop.read()
        self.recording.take_ticks(block)
        with self.guard.part("publisher", now_ns := self.clock_ns()):
            self.publisher.step(block, now_ns)
        self.recording.close()
        self.bench.plans.conclude()  # journalled before a recorder that hangs is waited for
        self.recording.recorder.stop()
        for name, pid in self.children.not_ended.items():
            self.bench.events.emit("process", f"{name} (pid {pid}) is {NOT_ENDED}", process=name)
        with self.guard.part("publisher", now_ns := self.clock_ns()):
            self.publisher.publish_documents(now_ns)  # how a plan has ended

    def run_until(self, done: Callable[[], object], limit_ns: int | None = None) -> None:
        """Step until `done()` is true, for `limit_ns` at most; a late step is not made up for."""
        begun_ns = due_ns = self.clock_ns()
        while not done():
            if limit_ns is not None and due_ns - begun_ns > limit_ns:
                return
            self.step()
            due_ns = max(due_ns + PERIOD_NS, self.clock_ns())
            self._take_requests_until(due_ns)

    def _take_requests_until(self, due_ns: int) -> None:
        """Sleep, and carry out what is requested meanwhile: no client waits for the next step."""
        calls = self.dispatcher.calls
        while (left_ns := due_ns - self.clock_ns()) > 0 and calls.wait(left_ns / 1e9):
            now_ns = self.clock_ns()
            with self.guard.part("requests", now_ns):
                self.dispatcher.take(now_ns)
            with self.guard.part("publisher", now_ns):  # who has a reply may ask for the state
                self.publisher.publish_documents(now_ns)
            time.sleep(max(0, min(EARLY_NS, due_ns - self.clock_ns())) / 1e9)
