"""The loop for `motord latency`: the simulated rig, run for so many ticks on request.

    python -m motord.loop.latency.measured_loop

Its standard input has a `Setup` as a line of JSON, then a line with two numbers for each slice:
how many ticks to run unmeasured, then how many measured. It answers with a `Ready` as a line of
JSON, then with a TIMING record for each slice.
"""

import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from motord import config
from motord.config import LoopConfig
from motord.control import parameters
from motord.control.types import SETPOINT
from motord.hal import registry
from motord.loop import control_loop, rt_setup
from motord.loop.hybrid_sleep import HybridSleep
from motord.loop.pacer import Pacer
from motord.loop.rt_setup import RealtimeStatus
from motord.shm.mailbox import MailboxReader, MailboxWriter
from motord.shm.ring import RingWriter
from motord.shm.tables import TablesReader, TablesWriter
from motord.shm.timing import Timing
from motord.unix_clock import Clock

RING_TICKS = 16384


class LoopSetup(BaseModel, frozen=True):
    """What loop to run: its section of the bench file, and its period."""

    loop: LoopConfig
    period_ns: int


class Ready(BaseModel, frozen=True):
    """With which rights the loop runs; priority 0 is normal priority."""

    realtime: RealtimeStatus
    priority: int


class SlicedLoop:
    """The loop of the packaged simulated bench, with its shared files in `folder`."""

    def __init__(self, setup: LoopSetup, folder: Path) -> None:
        bench = config.load().model_copy(update={"loop": setup.loop})
        TablesWriter(folder / "tables", bench.motor.counts).write(*parameters.build(bench))
        self._mailbox = MailboxWriter(folder / "setpoint", Clock.measure())
        self._control_loop = control_loop.ControlLoop(
            registry.make_rig(bench),
            RingWriter(folder / "ring", RING_TICKS),
            MailboxReader(folder / "setpoint"),
            TablesReader(folder / "tables"),
            control_loop.StopRequest(),
        )
        self._pacer = Pacer(setup.period_ns, HybridSleep(setup.period_ns, spin=setup.loop.spin))
        self._setpoint = np.zeros(1, SETPOINT)
        self._control_loop.warm_up_kernel()
        self._control_loop.rig.open()
        self._control_loop.warm_up_rig()

    def run(self, settle_ticks: int, ticks: int) -> Timing:
        """Run `settle_ticks`, then `ticks`, and return what the latter took."""
        timing = self._control_loop.timing
        self._control_loop.stop.reason = ""
        self._mailbox.write(self._setpoint)
        self._control_loop.warm_up_rig()  # it catches up with the time since the slice before
        control_loop.run(self._control_loop, self._pacer, settle_ticks)
        before = timing.copy()
        timing.wake_late.cells[-1] = timing.work.cells[-1] = 0  # the largest of this slice alone
        before.record["missed"] = 0  # the pacer counts anew with each start
        control_loop.run(self._control_loop, self._pacer, ticks)
        return timing.since(before)


def main() -> int:
    """Serve slices until standard input ends; returns the exit code."""
    setup = LoopSetup.model_validate_json(sys.stdin.buffer.readline())
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(prefix="motord-latency-", dir=memory) as folder:
        loop = SlicedLoop(setup, Path(folder))
        rights = rt_setup.apply(setup.loop)
        priority = os.sched_getparam(0).sched_priority
        ready = Ready(realtime=rights, priority=priority)
        answer = sys.stdout.buffer
        answer.write(ready.model_dump_json().encode() + b"\n")
        answer.flush()
        for line in sys.stdin.buffer:
            settle_ticks, ticks = map(int, line.split())
            answer.write(loop.run(settle_ticks, ticks).record.tobytes())
            answer.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
