"""Time for a device that may still be starting, for drivers that open it."""

import time
from collections.abc import Iterator


def countdown_s(timeout_s: float) -> Iterator[float]:
    """Yield the time left, again and again, the last time 0.

    So each who waits looks once more when time is up: at what came while a busy computer did not
    look.
    """
    end_s = time.monotonic() + timeout_s
    while (left_s := end_s - time.monotonic()) > 0:
        yield left_s
    yield 0.0
