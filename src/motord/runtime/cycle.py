"""The loop itself: wait, read, decide, write, publish. Nothing else happens in its process.

Everything it touches in a tick is made beforehand; the garbage collector is off, so what little
Python allocates is freed at once by reference counts.
"""

from dataclasses import dataclass, field

import numpy as np

from motord.control import step as kernel
from motord.control.types import COMMAND, FEEDBACK, SETPOINT
from motord.hal.base import Rig
from motord.runtime.histogram import TimeHistogram
from motord.runtime.mailbox import MailboxReader
from motord.runtime.pacer import INT32_MAX, Pacer
from motord.runtime.ring import RingWriter
from motord.runtime.tables import TablesReader
from motord.schema import State

SUPERVISOR_GONE_S = 5.0
"""Without a heartbeat for so long, and without torque, the loop ends by itself."""
_LOOK_EVERY_TICKS = 64


@dataclass
class StopRequest:
    """Set `reason` (from a signal handler) and the loop ends after the tick it is in."""

    reason: str = ""


@dataclass
class Cycle:
    """What a loop works with; `wake_late` and `work` are the histograms that it keeps."""

    rig: Rig
    ring: RingWriter
    mailbox: MailboxReader
    tables: TablesReader
    stop: StopRequest
    wake_late: TimeHistogram = field(default_factory=TimeHistogram)
    work: TimeHistogram = field(default_factory=TimeHistogram)
    memory: np.ndarray = field(default_factory=kernel.new_memory)
    feedback: np.ndarray = field(default_factory=lambda: np.zeros(1, FEEDBACK))
    setpoint: np.ndarray = field(default_factory=lambda: np.zeros(1, SETPOINT))
    command: np.ndarray = field(default_factory=lambda: np.zeros(1, COMMAND))

    def warm_up_kernel(self) -> None:
        """Compile or load the kernel by running it on copies of everything it will work on."""
        self.tables.poll()
        records = (self.memory, self.feedback, self.setpoint, self.command, self.ring.slot())
        for _ in range(3):
            kernel.step(*self.tables.current, *(record.copy() for record in records))

    def warm_up_rig(self) -> None:
        """Read the opened rig and command it to be off, so that no first time is left."""
        for _ in range(3):
            self.rig.read(self.mailbox.clock.now_ns(), self.feedback)
            self.rig.write(self.command)

    def supervisor_gone(self, now_ns: int) -> bool:
        """Return whether the supervisor has been silent for long and no torque is applied."""
        silent_ns = now_ns - int(self.setpoint["heartbeat_ns"][0])
        enabled = int(self.memory["state"][0]) == State.ENABLED
        return silent_ns > SUPERVISOR_GONE_S * 1e9 and not enabled


def run(cycle: Cycle, pacer: Pacer) -> None:
    """Run ticks until a stop is requested or the supervisor is gone; sets `stop.reason`."""
    rig_read, rig_write, step = cycle.rig.read, cycle.rig.write, kernel.step
    mailbox_read, tables, ring = cycle.mailbox.read, cycle.tables, cycle.ring
    memory, feedback, setpoint, command = (
        cycle.memory,
        cycle.feedback,
        cycle.setpoint,
        cycle.command,
    )
    records, stop = ring.records, cycle.stop
    tick, missed, flags = records["tick"], records["missed"], records["flags"]
    wake_late, work = records["wake_late_ns"], records["work_ns"]
    begun_ns, heartbeat_ns = feedback["now_ns"], setpoint["heartbeat_ns"]
    count_wake_late, count_work = cycle.wake_late.add, cycle.work.add
    offset_ns = cycle.mailbox.clock.offset_ns
    clock_ns, wait = pacer.clock_ns, pacer.wait
    work_ns = 0
    parameters, back_emf, cogging = tables.current
    heartbeat_ns[0] = clock_ns() + offset_ns
    pacer.start()
    while not stop.reason:
        woke_ns = wait()
        now_ns = woke_ns + offset_ns
        begun_ns[0] = now_ns
        rig_read(now_ns, feedback)
        mailbox_read(setpoint)
        if tables.poll():
            parameters, back_emf, cogging = tables.current
        i = ring.index
        tick[i] = pacer.tick
        missed[i] = pacer.missed
        flags[i] = pacer.flags
        wake_late[i] = pacer.late_ns
        work[i] = work_ns
        step(
            parameters,
            back_emf,
            cogging,
            memory,
            feedback,
            setpoint,
            command,
            records[i : i + 1],
        )
        rig_write(command)
        ring.publish()
        count_wake_late(pacer.late_ns)
        work_ns = min(clock_ns() - woke_ns, INT32_MAX)
        count_work(work_ns)
        if not i % _LOOK_EVERY_TICKS and cycle.supervisor_gone(now_ns):
            stop.reason = "the supervisor is gone"
