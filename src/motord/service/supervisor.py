"""The supervisor's loop: about a hundred times a second, and never waiting for anyone.

Ticks in, requests carried out, the bench advanced, the heartbeat written; everything that could
take long (devices, the network, the disk) happens in other threads or processes. Of the parts only
the bench may end the daemon by an error; the others are in the table of `service.guard`.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from motord.schema import Request
from motord.schema import State as DriveState
from motord.service.bench.bench import Bench
from motord.service.bench.guard import Guard
from motord.service.bench.loop_link import LOOP, LoopLink
from motord.service.bench.recording import RecordingControl
from motord.service.gateway.link import GateLink
from motord.service.host.log import log_error
from motord.service.host.systemd import Notifier
from motord.service.processes import Children
from motord.service.publish.publisher import Publisher
from motord.service.rpc.dispatcher import Dispatcher

PERIOD_NS = 10_000_000
RAMP_MARGIN_S = 1.0
STOP_NS = 300_000_000
RECORDER_START_NS = 20_000_000_000


@dataclass
class Supervisor:
    """All parts of the daemon, and the order in which they get their turn."""

    bench: Bench
    dispatcher: Dispatcher
    children: Children
    loop: LoopLink
    recording: RecordingControl
    publisher: Publisher
    gate: GateLink | None = None
    notifier: Notifier = field(default_factory=Notifier)
    clock_ns: Callable[[], int] = time.monotonic_ns
    guard: Guard = field(init=False)

    def __post_init__(self) -> None:
        bench = self.bench
        self.guard = Guard(
            bench.events, bench.fault_stop, lambda: bench.setpoint.request(Request.STOP)
        )

    def step(self) -> None:
        """Do everything that is due now."""
        now_ns, part = self.clock_ns(), self.guard.part
        with part("loop link", now_ns):
            self.loop.follow()
        block, lost = self.loop.read()
        with part("processes", now_ns):
            self._follow_processes(now_ns)
        with part("requests", now_ns):
            self.dispatcher.take(now_ns)
        self.bench.step(block, lost, now_ns)
        with part("answers", now_ns):
            self.dispatcher.step(now_ns)
        with part("gateway", now_ns):
            if self.gate is not None:
                self.gate.step(now_ns)
        with part("recording", now_ns):
            self.recording.step(now_ns, block)
        with part("publisher", now_ns):
            self.publisher.step(block, now_ns)
        with part("service manager", now_ns):
            self.notifier.progress(self.bench.monitor.ticks, now_ns)

    def _follow_processes(self, now_ns: int) -> None:
        """Say who has ended; those that are due are started again."""
        for end in self.children.poll(now_ns):
            if end.spec.name == LOOP:
                self.loop.ended(end)
            else:
                again = f"; again in {end.again_s:g} s" if end.again_s is not None else ""
                self.bench.events.emit(
                    "process", f"{end.spec.name} ended: {end.how}: {end.spec.consequence}{again}"
                )

    def run(self, stopping: Callable[[], object]) -> None:
        """Step until `stopping()` is true; a step that comes late is not made up for."""
        self._until(stopping, None)

    def wait_for_loop(self, stopping: Callable[[], object]) -> bool:
        """Step until the loop is up and recorded (True), or has failed or is to stop (False)."""
        self._until(lambda: stopping() or self.loop.phase != "starting", None)
        if self.loop.phase != "up":
            return False
        self._until(lambda: stopping() or self.recording.settled, RECORDER_START_NS)
        return not stopping()

    def ramp_down(self, why: str) -> None:
        """Ramp the torque to zero, disable, go OFF; whatever takes too long is cut short."""
        bench, limits = self.bench, self.bench.config.limits
        bench.events.emit("daemon", f"shutting down: {why}")
        bench.plans.abort("the daemon shuts down")
        bench.disable()
        ramp_s = limits.torque_Nm / limits.torque_rate_Nm_per_s + RAMP_MARGIN_S
        self._until(lambda: bench.state is not DriveState.ENABLED, round(ramp_s * 1e9))
        bench.stop("the daemon shut down")
        over = (DriveState.OFF, DriveState.TRIPPED)
        self._until(lambda: bench.state in over, STOP_NS)

    def emergency(self, error: Exception) -> str:
        """Take the current away at once after an error in the program; return it in a line.

        The daemon ends with it: nobody knows in what state it left the supervisor. So nothing is
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
                seen_seq, state = (
                    int(block["setpoint_seq"][-1]),
                    DriveState(int(block["state"][-1])),
                )
            if state in (DriveState.OFF, DriveState.TRIPPED):
                break
            time.sleep(PERIOD_NS / 1e9)
        said = log_error("in the supervisor", error)
        with suppress(Exception):  # whoever listens may be what erred
            self.bench.events.emit("fault", f"{said}; stopped, the daemon ends")
        return said

    def take_down(self) -> None:
        """Take no more requests, end the loop, then the recorder, which by then has everything."""
        self.dispatcher.close("the daemon is shutting down")
        if self.gate is not None:
            self.gate.stop(self.clock_ns())
        self.children.stop(LOOP)
        self.publisher.step(self.loop.read()[0], self.clock_ns())
        self.recording.stop()

    def _until(self, done: Callable[[], object], limit_ns: int | None) -> None:
        begun_ns = due_ns = self.clock_ns()
        while not done():
            if limit_ns is not None and due_ns - begun_ns > limit_ns:
                return
            self.step()
            due_ns = max(due_ns + PERIOD_NS, self.clock_ns())
            time.sleep(max(0.0, (due_ns - self.clock_ns()) / 1e9))
