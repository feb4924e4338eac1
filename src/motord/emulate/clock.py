"""The host's two clocks: monotonic, by which the emulator runs, and Unix, in messages and logs."""

import time

REFRESH_NS = 1_000_000_000
_TRIES = 3


class HostClock:
    """Maps monotonic to Unix time and back; follows a Unix clock that is being adjusted."""

    def __init__(self) -> None:
        self._refreshed_ns = 0
        self._offset_ns = 0
        self.refresh(time.monotonic_ns())

    def refresh(self, now_ns: int) -> None:
        """Measure how far the clocks are apart, once a second at most."""
        if self._refreshed_ns and now_ns - self._refreshed_ns < REFRESH_NS:
            return
        self._refreshed_ns = now_ns
        tries = []
        for _ in range(_TRIES):
            before_ns = time.monotonic_ns()
            unix_ns = time.time_ns()
            after_ns = time.monotonic_ns()
            tries.append((after_ns - before_ns, unix_ns - (before_ns + after_ns) // 2))
        self._offset_ns = min(tries)[1]

    def unix_ns(self, monotonic_ns: int) -> int:
        """Return the Unix time of a monotonic time."""
        return monotonic_ns + self._offset_ns

    def monotonic_ns(self, unix_ns: int) -> int:
        """Return the monotonic time of a Unix time."""
        return unix_ns - self._offset_ns
