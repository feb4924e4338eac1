"""When the next tick is due: absolute deadlines in integer ns, and what to do about lateness.

Tick n is due at start + (n + 1) periods and owns the period after that. Each tick runs at most
once and only within its own period: a loop that comes late skips the periods that are over,
counts them and goes on in phase, so a stall is never followed by a burst.
"""

from motord.loop.hybrid_sleep import HybridSleep
from motord.schema import INT32_MAX, Flag

_LATE = int(Flag.LATE)
_AFTER_GAP = int(Flag.AFTER_GAP)


class Pacer:
    """Deadlines of a loop of period `period_ns`; `alarm` reads and passes the time.

    After `wait()`: `tick` (counter of periods), `missed` (periods skipped so far), `late_ns`
    (wake-up after the deadline waited for) and `flags` (LATE, AFTER_GAP) describe the tick.
    """

    def __init__(self, period_ns: int, alarm: HybridSleep) -> None:
        self.period_ns = period_ns
        self._half_ns = period_ns // 2
        self._alarm = alarm
        self.clock_ns = alarm.clock_ns
        self.start()

    def start(self) -> None:
        """Start counting: tick 0 is due one period from now."""
        self._alarm.start()
        self._deadline_ns = self.clock_ns()
        self.tick = -1
        self.missed = 0
        self.late_ns = 0
        self.flags = 0

    def wait(self) -> int:
        """Wait for the next tick and return the time of waking up (monotonic ns).

        Work that ran more than half a period into the next tick skips that tick. A wake-up that
        is later than whole periods skips these. A loop that is busy for too large a share of the
        time skips one tick more.
        """
        alarm = self._alarm
        period_ns = self.period_ns
        deadline_ns = self._deadline_ns + period_ns
        tick = self.tick + 1
        behind_ns = self.clock_ns() - deadline_ns - self._half_ns
        if behind_ns > 0:
            over = -(-behind_ns // period_ns)
            deadline_ns += over * period_ns
            tick += over
        if alarm.budget_exceeded:
            deadline_ns += period_ns
            tick += 1
        woke_ns = alarm.wait_until(deadline_ns)
        late_ns = woke_ns - deadline_ns
        if late_ns >= period_ns:
            over = late_ns // period_ns
            deadline_ns += over * period_ns
            tick += over
        gap = tick - self.tick - 1
        self.missed += gap
        self.tick = tick
        self.late_ns = late_ns if late_ns < INT32_MAX else INT32_MAX
        self.flags = (_LATE if late_ns > self._half_ns else 0) | (_AFTER_GAP if gap else 0)
        self._deadline_ns = deadline_ns
        return woke_ns
