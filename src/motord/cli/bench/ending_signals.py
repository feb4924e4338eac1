"""SIGTERM, and SIGHUP of a terminal that is closed: they end the screen, also one that hangs."""

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from motord.process.signal_handlers import handled

GIVE_UP_S = 5.0
"""A program that has not ended so long after a signal hangs: the process ends without it."""
_NUMBERS = (signal.SIGTERM, signal.SIGHUP)


@contextmanager
def ending_signals(end: Callable[[], object], give_up: Callable[[], object]) -> Iterator[None]:
    """Call `end` at a signal; if the process goes on after it, `give_up`, and end the process.

    A thread takes them from Python's wake-up descriptor. The kernel may deliver a signal to any
    thread, and the main one, where Python runs handlers, may wait for a terminal that takes no more
    output: it would never get to them.
    """
    receiving, sending = socket.socketpair()
    sending.setblocking(False)
    threading.Thread(
        target=_take, args=(receiving, end, give_up), name="motord-signals", daemon=True
    ).start()
    with sending, handled(_NUMBERS, lambda *_: None):
        descriptor = signal.set_wakeup_fd(sending.fileno(), warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(descriptor)


def _take(
    receiving: socket.socket, end: Callable[[], object], give_up: Callable[[], object]
) -> None:
    with receiving:
        while received := receiving.recv(1):
            if received[0] in _NUMBERS:
                break
        else:
            return
    end()
    time.sleep(GIVE_UP_S)
    giving_up = threading.Thread(target=give_up, daemon=True)  # it may wait for the daemon
    giving_up.start()
    giving_up.join(GIVE_UP_S)
    os._exit(128 + received[0])
