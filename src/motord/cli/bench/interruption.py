"""Ctrl-C, SIGTERM and SIGHUP (a terminal that is closed) end a command in the same way."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def interrupted_once() -> Iterator[Callable[[], None]]:
    """Let the first of the signals raise KeyboardInterrupt in the block.

    Later ones do not disturb the clearing up, nor does any after a call of what is yielded. Those
    that are ignored stay so (nohup).
    """
    held_off = False

    def hold_off() -> None:
        nonlocal held_off
        held_off = True

    def interrupt(number: int, frame: FrameType | None) -> None:
        if not held_off:
            hold_off()
            raise KeyboardInterrupt

    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in NUMBERS:
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, interrupt)
    try:
        yield hold_off
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
