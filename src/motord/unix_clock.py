"""Unix time that never steps: the monotonic clock plus an offset measured once.

All processes of a daemon use the offset that its supervisor measured (it is in the set-point
mailbox), so heartbeats, ticks and events stay comparable when the system's clock is set.
"""

import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Clock:
    """Unix time in ns: `time.monotonic_ns()` plus `offset_ns`."""

    offset_ns: int

    @classmethod
    def measure(cls, attempts: int = 5) -> "Clock":
        """Measure the offset between the system's Unix time and its monotonic clock."""
        best_width_ns, offset_ns = 2**63, 0
        for _ in range(attempts):
            before_ns = time.monotonic_ns()
            unix_ns = time.time_ns()
            width_ns = time.monotonic_ns() - before_ns
            if width_ns < best_width_ns:
                best_width_ns, offset_ns = width_ns, unix_ns - before_ns - width_ns // 2
        return cls(offset_ns)

    def now_ns(self) -> int:
        """Return the Unix time in ns."""
        return time.monotonic_ns() + self.offset_ns


def suspended_ns() -> int:
    """Return for how long the computer has been suspended, which its monotonic clock leaves out."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()
