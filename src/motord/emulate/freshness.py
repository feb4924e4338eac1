"""Whether the inverter's feedback may leave: it carries no time, its stamp is that of its arrival.

Of what is due at once only the newest leaves, as no inverter queues measurements, and that not if
it is old by now, unless none has left for long. A process that was kept from running since it took
in the host's commands looks for those that came meanwhile: nothing leaves that is of before one
which asks for no power.
"""

from collections.abc import Callable

AGE_MAX_NS, SILENCE_MAX_NS = 5_000_000, 100_000_000
"""Older currents do not leave, which the host would take for those of their arrival; but after such
a silence they do, however old: the computer is always late."""
HELD_UP_NS = 100_000_000
"""So long after commands were taken in, those that have come meanwhile are looked at first."""


class Freshness:
    """Judges feedback by the time at which it would leave. All times are monotonic.

    late: how often the currents of an instant have not left.
    """

    def __init__(self, period_ns: int, clock_ns: Callable[[], int]) -> None:
        """Judge feedback that is due every `period_ns`."""
        self._period_ns, self._clock_ns = period_ns, clock_ns
        self._left_ns = 0
        self.late = 0

    def currents_leave(self, at_ns: int, listened_ns: int) -> bool:
        """Return whether currents of `at_ns` leave, by commands taken in at `listened_ns`."""
        now_ns = self._clock_ns()
        silent = now_ns - self._left_ns >= SILENCE_MAX_NS
        leave = self.newest(at_ns, listened_ns) and (now_ns - at_ns < AGE_MAX_NS or silent)
        if leave:
            self._left_ns = now_ns
        else:
            self.late += 1
        return leave

    def newest(self, at_ns: int, listened_ns: int) -> bool:
        """Return whether `at_ns` is the last instant of what is due at `listened_ns`."""
        return listened_ns - at_ns < self._period_ns

    def held_up(self, listened_ns: int) -> bool:
        """Return whether the process has been kept from running since it listened."""
        return self._clock_ns() - listened_ns >= HELD_UP_NS
