"""How many messages a page may send: so many a second on average, so many at once."""

import time

PER_S, AT_ONCE = 200.0, 400.0


class RateLimit:
    """A token bucket."""

    why = f"more than {PER_S:g} messages a second"

    def __init__(self) -> None:
        self._left = AT_ONCE
        self._seen_s = time.monotonic()

    def allows(self) -> bool:
        """Count a message; False if it is one too many."""
        now_s = time.monotonic()
        self._left = min(AT_ONCE, self._left + PER_S * (now_s - self._seen_s)) - 1
        self._seen_s = now_s
        return self._left >= 0
