"""The loop itself: wait, read, decide, write, publish. Nothing else happens in its process.

Everything it touches in a tick is made beforehand; the garbage collector is off, so what little
Python allocates is freed at once by reference counts.
"""

from dataclasses import dataclass, field
from itertools import repeat

import numpy as np

from motord.control.step import new_memory
from motord.control.types import COMMAND, FEEDBACK, SETPOINT
from motord.hal.base import Rig
from motord.loop.pacer import Pacer
from motord.loop.tick_kernel import NO_WORK, TickKernel, run_tick
from motord.schema import INT32_MAX, State
from motord.shm.mailbox import MailboxReader
from motord.shm.ring import RingWriter
from motord.shm.tables import TablesReader
from motord.shm.time_count import count_time
from motord.shm.timing import Timing

SUPERVISOR_GONE_S = 5.0
"""Without a heartbeat for so long, and without torque, the loop ends by itself."""
_LOOK_EVERY_TICKS = 64


@dataclass
class StopRequest:
    """Set `reason` (from a signal handler) and the loop ends after the tick it is in."""

    reason: str = ""


@dataclass
class ControlLoop:
    """What the loop works with; `timing` holds its histograms."""

    rig: Rig
    ring: RingWriter
    mailbox: MailboxReader
    tables: TablesReader
    stop: StopRequest
    timing: Timing = field(default_factory=Timing)
    memory: np.ndarray = field(default_factory=new_memory)
    feedback: np.ndarray = field(default_factory=lambda: np.zeros(1, FEEDBACK))
    setpoint: np.ndarray = field(default_factory=lambda: np.zeros(1, SETPOINT))
    command: np.ndarray = field(default_factory=lambda: np.zeros(1, COMMAND))

    def kernel(self) -> TickKernel:
        """Return the compiled tick, bound to all of this."""
        records = (self.memory, self.feedback, self.setpoint, self.command, self.ring.records)
        return TickKernel(self.tables.current, self.timing.record, *records)

    def warm_up_kernel(self) -> None:
        """Compile or load the tick by running it on copies of everything it will work on."""
        self.tables.poll()
        records = (self.memory, self.feedback, self.setpoint, self.command, self.ring.slot())
        copies = (record.copy() for record in records)
        kernel = TickKernel(self.tables.current, Timing().record, *copies)
        for _ in range(3):
            run_tick(kernel.frame, 0, 0, 0, 0, 0, NO_WORK)

    def warm_up_rig(self) -> None:
        """Read the opened rig and command it to be off, so that no first time is left."""
        for _ in range(3):
            self.rig.read(self.mailbox.clock.now_ns(), self.feedback)
            self.rig.write(self.command)

    def set_board_clock(self) -> None:
        """Publish the error of the bridge board's clock, if it has one."""
        if (clock := self.rig.clock) is not None:
            self.timing.set_board_clock(clock.drift_ppm, clock.jitter_ns)

    def end_reason(self, now_ns: int) -> str:
        """Return why the loop ends by itself, "" while it does not: no torque is applied then."""
        if int(self.memory["state"][0]) == State.ENABLED:
            return ""
        if now_ns - int(self.setpoint["heartbeat_ns"][0]) > SUPERVISOR_GONE_S * 1e9:
            return "the supervisor is gone"
        return self.rig.refused


def run(loop: ControlLoop, pacer: Pacer, ticks: int | None = None) -> None:
    """Run ticks until a stop is requested or there is an `end_reason`; sets `stop.reason`.

    With `ticks`, run at most so many, then return and leave the reason empty.
    """
    rig_read, rig_write, mailbox_read = loop.rig.read, loop.rig.write, loop.mailbox.read
    feedback, setpoint, command = loop.feedback, loop.setpoint, loop.command
    tables, ring, stop, kernel = loop.tables, loop.ring, loop.stop, loop.kernel()
    begun_ns, frame, publish, poll = feedback["now_ns"], kernel.frame, ring.publish, tables.poll
    offset_ns, clock_ns, wait = loop.mailbox.clock.offset_ns, pacer.clock_ns, pacer.wait
    work_ns = NO_WORK
    setpoint["heartbeat_ns"][0] = clock_ns() + offset_ns
    pacer.start()
    for _ in repeat(None) if ticks is None else repeat(None, ticks):
        if stop.reason:
            break
        woke_ns = wait()
        begun_ns[0] = now_ns = woke_ns + offset_ns
        rig_read(now_ns, feedback)
        mailbox_read(setpoint)
        if poll():
            kernel.use(tables.current)
        i = ring.index
        run_tick(frame, i, pacer.tick, pacer.missed, pacer.flags, pacer.late_ns, work_ns)
        rig_write(command)
        publish()
        work_ns = min(clock_ns() - woke_ns, INT32_MAX)
        if not i % _LOOK_EVERY_TICKS:
            loop.set_board_clock()
            if reason := loop.end_reason(now_ns):
                stop.reason = reason
    if work_ns != NO_WORK:
        count_time(loop.timing.work.cells, work_ns)
