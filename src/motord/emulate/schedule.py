"""When something periodic is due: absolute instants, start + n / rate, without drift."""


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
