"""Ctrl-C that is not lost where Python lets no exception out, and signals that end as it does.

A signal's handler raises in whatever the main thread does at that moment. In a finaliser or in the
callback of a weak reference, of which each import has some, Python reports an exception and goes on
(`sys.unraisablehook`): what was to be interrupted would never know.
"""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

from motord.process.signal_handlers import handled

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

AGAIN = signal.SIGALRM
"""Comes AGAIN_S after a KeyboardInterrupt was lost: its handler is to raise another."""

ENDING = (signal.SIGTERM, signal.SIGHUP)

AGAIN_S = 0.02
"""Longer than a finaliser or a callback takes; and if not, it comes again."""


def recover_lost_interrupts() -> None:
    """Raise KeyboardInterrupt a moment later where one was lost; for the whole process."""
    signal.signal(AGAIN, _interrupt)
    report = sys.unraisablehook

    def hook(lost: "UnraisableHookArgs") -> None:
        if isinstance(lost.exc_value, KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
        else:
            report(lost)

    sys.unraisablehook = hook


@contextmanager
def ending_as_interrupts() -> Iterator[list[int]]:
    """Let SIGTERM and SIGHUP raise KeyboardInterrupt in the block, once; give those that came.

    One that is ignored stays so (nohup). In a process that was forked they end it, as without this.
    """
    came: list[int] = []
    owner = os.getpid()

    def interrupt(number: int, _frame: FrameType | None) -> None:
        if os.getpid() != owner:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        elif not came:
            came.append(number)
            raise KeyboardInterrupt

    with handled([n for n in ENDING if signal.getsignal(n) is signal.SIG_DFL], interrupt):
        yield came


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
