"""Ctrl-C, SIGTERM and SIGHUP (a terminal that is closed) end a command in the same way."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interruption:
    """Raises KeyboardInterrupt for the first signal; later ones do not disturb the clearing up."""

    def __init__(self) -> None:
        self._held_off = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Take a signal."""
        if not self._held_off:
            self._held_off = True
            raise KeyboardInterrupt

    def hold_off(self) -> None:
        """Take no notice of signals from now on."""
        self._held_off = True


@contextmanager
def interrupted_once() -> Iterator[Interruption]:
    """Let the first of the signals interrupt the block. Those that are ignored stay so (nohup)."""
    interruption = Interruption()
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in NUMBERS:
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, interruption)
    try:
        yield interruption
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
