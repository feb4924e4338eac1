"""Ctrl-C that is not lost where Python lets no exception out.

A signal's handler raises in whatever the main thread does at that moment. In a finaliser or in the
callback of a weak reference, of which each import has some, Python reports an exception and goes on
(`sys.unraisablehook`): what was to be interrupted would never know.
"""

import signal
import sys
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

AGAIN = signal.SIGALRM
"""Comes AGAIN_S after a KeyboardInterrupt was lost: its handler is to raise another."""

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


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
