"""The host's two clocks: monotonic, by which the emulator runs, and Unix, in messages and logs.

What is periodic is due at absolute instants, start + n / rate, without drift.
"""

import time

from motord.unix_clock import Clock

REFRESH_NS = 1_000_000_000
_ATTEMPTS = 3


class HostClock:
    """Maps monotonic to Unix time and back; follows a Unix clock that is being adjusted."""

    def __init__(self) -> None:
        self._refreshed_ns = time.monotonic_ns()
        self._offset_ns = Clock.measure(_ATTEMPTS).offset_ns

    def refresh(self, now_ns: int) -> None:
        """Measure the offset between the clocks, once a second at most."""
        if now_ns - self._refreshed_ns >= REFRESH_NS:
            self._refreshed_ns = now_ns
            self._offset_ns = Clock.measure(_ATTEMPTS).offset_ns

    def unix_ns(self, monotonic_ns: int) -> int:
        """Return the Unix time of a monotonic time."""
        return monotonic_ns + self._offset_ns

    def monotonic_ns(self, unix_ns: int) -> int:
        """Return the monotonic time of a Unix time."""
        return unix_ns - self._offset_ns


class Schedule:
    """Instants `rate_Hz` times a second from `start_ns` on; `next_ns` is the one to come."""

    def __init__(self, start_ns: int, rate_Hz: int) -> None:
        self.restart(start_ns, rate_Hz)

    def restart(self, start_ns: int, rate_Hz: int) -> None:
        """Start anew, with another rate if need be."""
        self.rate_Hz = rate_Hz
        self._start_ns = start_ns
        self._count = 0
        self.next_ns = start_ns

    def due(self, at_ns: int) -> bool:
        """Return whether `at_ns` is the instant to come, and go on to the one after it."""
        if self.next_ns != at_ns:
            return False
        self._go_to(self._count + 1)
        return True

    def skip_to(self, now_ns: int) -> int:
        """Leave out the instants before `now_ns`; return how many."""
        if self.next_ns >= now_ns:
            return 0
        before = self._count
        self._go_to(-((self._start_ns - now_ns) * self.rate_Hz // 1_000_000_000))
        return self._count - before

    def _go_to(self, count: int) -> None:
        self._count = count
        self.next_ns = self._start_ns + count * 1_000_000_000 // self.rate_Hz
