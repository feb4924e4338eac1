"""The loop process as the supervisor sees it: started, ready, publishing ticks, ended."""

import signal
from contextlib import suppress
from typing import Any, Literal

import numpy as np

from motord.api.messages import ClockView
from motord.loop.status import LoopPhase, LoopStatus
from motord.schema import TICK_DTYPE
from motord.service.host.children import Children, Ended
from motord.shm.ring import RingReader
from motord.shm.run_directory import RunDir
from motord.shm.shared_records import SharedFileError
from motord.shm.timing import Timing

LOOP = "loop"


class LoopLink:
    """Follows the loop from start to ready to its end; `phase` is "down", "starting" or "up"."""

    def __init__(self, children: Children, run_dir: RunDir) -> None:
        self._children = children
        self._run_dir = run_dir
        self._ring: RingReader | None = None
        self._timing: Timing | None = None
        self.phase: Literal["down", "starting", "up"] = "down"
        self.status: LoopStatus | None = None

    def start(self, now_ns: int) -> None:
        """Start the loop, unless it runs. It comes up OFF."""
        if self.phase != "down":
            return
        with suppress(OSError):  # then the loop's own status takes its place
            self._run_dir.loop_status.unlink(missing_ok=True)
        self._children.start(LOOP, now_ns)
        self.phase = "starting"

    def kill(self) -> None:
        """End a loop that hangs; inverter and bridge have taken the current away by then."""
        self._children.signal(LOOP, signal.SIGKILL)

    def follow(self) -> bool:
        """Attach to a loop that has become ready; return True if it has.

        Raises OSError if what it has made ready cannot be opened yet, or makes no sense.
        """
        if self.phase != "starting":
            return False
        status = LoopStatus.read(self._run_dir.loop_status)
        if status is None or status.phase is not LoopPhase.READY:
            return False
        try:
            self._ring = RingReader(self._run_dir.ring, "oldest")
        except SharedFileError as error:
            raise OSError(f"the loop is ready, but its ring is not: {error}") from error
        self.status = status
        with suppress(SharedFileError):
            self._timing = Timing.attach(self._run_dir.timing)
        self.phase = "up"
        return True

    def read(self) -> tuple[np.ndarray, int]:
        """Return (block, lost), the ticks published since the last call."""
        if self._ring is None:
            return np.empty(0, TICK_DTYPE), 0
        return self._ring.read()

    def ended(self, end: Ended) -> str:
        """Note that the loop process has ended by itself; return why."""
        why = f"the loop ended: {end.how}"
        status = None
        with suppress(OSError):  # without its status file, the exit code remains
            status = LoopStatus.read(self._run_dir.loop_status)
        if status is not None and status.error:
            why = f"the loop ended: {status.error}"
        elif status is not None and status.phase is LoopPhase.STOPPED and status.reason:
            why = f"the loop ended: {status.reason}"
        elif not self._run_dir.path.is_dir():
            why += f"; {self._run_dir.path} was removed: end the daemon and start it again"
        self.phase, self._ring = "down", None
        return why

    def realtime(self) -> dict[str, Any]:
        """Return the real-time rights of the loop, for clients and recordings."""
        status = self.status
        if status is None or status.realtime is None:
            return {}
        return {
            "granted": status.realtime.granted,
            "lines": status.realtime.lines(),
            "kernel": status.realtime.kernel,
            "preemption": status.realtime.preemption,
            "foreign_threads": status.foreign_threads,
        }

    def bridge_clock(self) -> ClockView | None:
        """Return drift and jitter of the bridge's clock; None for a loop without one."""
        if self._timing is None or self.phase != "up":
            return None
        clock = self._timing.clock
        if not any(clock):
            return None
        return ClockView(drift_ppm=round(clock.drift_ppm, 2), jitter_us=round(clock.jitter_us, 1))
