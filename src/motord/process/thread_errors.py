"""Threads that their process cannot do without: an error that ends one ends the process, too."""

import os
import sys
import threading


def end_with_any_thread() -> None:
    """Have this process end, as by an error in its main thread, if one ends any thread of it.

    Else it would go on without what the thread was for, and nobody would start it again.
    """
    report = threading.excepthook

    def end(error: threading.ExceptHookArgs) -> None:
        try:
            report(error)
            sys.stderr.flush()
        finally:  # also where nobody takes what it writes
            os._exit(1)

    threading.excepthook = end
