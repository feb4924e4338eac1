"""Handlers of signals for as long as a block runs."""

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType

Handler = Callable[[int, FrameType | None], object]
INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""What ends a command: by its user, by the system, as its terminal is gone."""
OF_TERMINAL = (signal.SIGINT, signal.SIGHUP)
"""What the end of a command by its terminal sends to the processes that it has started, too."""


@contextmanager
def handled(numbers: Iterable[signal.Signals], handler: Handler) -> Iterator[None]:
    """Let `handler` take the signals while the block runs; for the main thread.

    A SIGHUP that is ignored stays so (nohup).
    """
    taken = [n for n in numbers if (n, signal.getsignal(n)) != (signal.SIGHUP, signal.SIG_IGN)]
    before = {number: signal.signal(number, handler) for number in taken}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


@contextmanager
def put_off(numbers: Iterable[signal.Signals]) -> Iterator[None]:
    """Let the handlers of signals wait until the block is over; only a main thread has any."""
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        numbers = ()
    with handled(
        [number for number in numbers if callable(signal.getsignal(number))],
        lambda number, _frame: came.append(number),
    ):
        yield
    for number in came[:1]:
        signal.raise_signal(number)


@contextmanager
def blocked(numbers: Iterable[signal.Signals]) -> Iterator[None]:
    """Block signals while a process is started, which inherits that, from its first instruction.

    One that ignored Ctrl-C would show a traceback of it until it has imported enough.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
