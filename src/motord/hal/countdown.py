"""Time to wait for a device, with one more look when it is over.

So each who waits sees what came while a busy computer did not look.
"""

import time
from collections.abc import Iterator


class Countdown:
    """The time that is left of `timeout_s` from now on."""

    def __init__(self, timeout_s: float) -> None:
        self._end_s = time.monotonic() + timeout_s
        self._over = False

    def left_s(self) -> float:
        """Return how long to wait; 0 once, when time is up. Raises TimeoutError after that."""
        left_s = self._end_s - time.monotonic()
        if left_s > 0 and not self._over:
            return left_s
        if self._over:
            raise TimeoutError
        self._over = True
        return 0.0


def countdown_s(timeout_s: float) -> Iterator[float]:
    """Yield the time left, again and again, the last time 0."""
    countdown = Countdown(timeout_s)
    while True:
        try:
            left_s = countdown.left_s()
        except TimeoutError:
            return
        yield left_s
