"""The host's two clocks: monotonic, by which the emulator runs, and Unix, in messages and logs."""

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
