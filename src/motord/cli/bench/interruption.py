"""Ctrl-C, SIGTERM and SIGHUP (a terminal that is closed) end a command in the same way."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from motord.signal_handlers import handled

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

    is_main = threading.current_thread() is threading.main_thread()
    taken = [n for n in NUMBERS if is_main and signal.getsignal(n) is not signal.SIG_IGN]
    with handled(taken, interrupt):
        yield hold_off
