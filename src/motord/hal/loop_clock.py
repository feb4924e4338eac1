"""The clock of the loop's `now_ns` at any moment, and stamps of CAN frames in it."""

import time

from motord.unix_clock import Clock

MEASURED_AGAIN_NS = 1_000_000_000
"""Between two measurements of the system's clock that no stamp asks for: a step of less than a
period makes none implausible."""
ATTEMPTS = 3
"""Readings of both clocks for a measurement, of which the quickest counts."""


class LoopClock:
    """The clock of `now_ns`: the monotonic one plus an offset, learnt from the calls themselves.

    The system's clock is ahead of the monotonic one by what changes only where somebody sets it. So
    that is measured now and then, and where a stamp cannot be right by it: what is received after a
    call of `observe` came after the call before.
    """

    def __init__(self) -> None:
        self._system_ns = self._was_ns = Clock.measure(ATTEMPTS).offset_ns
        self._offset_ns = self._system_ns
        self._observed = False
        self._before_ns = self._observed_ns = self._shift_ns = 0
        self._measured_ns, self._measures_ns = -1, 0

    def observe(self, now_ns: int) -> None:
        """Take that it was `now_ns` a moment ago: of many moments the shortest counts."""
        offset_ns = now_ns - time.monotonic_ns()
        if offset_ns > self._offset_ns or not self._observed:
            self._offset_ns, self._observed = offset_ns, True
            self._shift_ns = offset_ns - self._system_ns
        self._before_ns, self._observed_ns = self._observed_ns, now_ns
        if now_ns >= self._measures_ns:
            self._measure()

    def now_ns(self) -> int:
        """Return the loop's time of this moment."""
        return time.monotonic_ns() + self._offset_ns

    def from_system(self, t_ns: int) -> int:
        """Return the loop's time of a Unix time at which the kernel or a library received a frame.

        Of frames that were received since the last call of `observe`.
        """
        at_ns = t_ns + self._shift_ns
        return at_ns if self._before_ns <= at_ns <= self._observed_ns else self._doubted(t_ns)

    def _doubted(self, t_ns: int) -> int:
        """Return the loop's time of a stamp that is not of the time before `observe` was called.

        It may be of since then. If the system's clock has just been set, it may be of before or
        after that. Else the frame has been waiting for long, or was stamped by another clock: it is
        taken at its word.
        """
        now_ns = self.now_ns()
        if self._observed_ns < t_ns + self._shift_ns <= now_ns:
            return t_ns + self._shift_ns
        if self._measured_ns != self._observed_ns:
            self._measure()
        for system_ns in (self._system_ns, self._was_ns):
            at_ns = t_ns - system_ns + self._offset_ns
            if self._before_ns <= at_ns <= now_ns:
                return at_ns
        return t_ns + self._shift_ns

    def _measure(self) -> None:
        self._was_ns, self._system_ns = self._system_ns, Clock.measure(ATTEMPTS).offset_ns
        self._shift_ns = self._offset_ns - self._system_ns
        self._measured_ns = self._observed_ns
        self._measures_ns = self._observed_ns + MEASURED_AGAIN_NS
