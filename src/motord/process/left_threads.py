"""The end of a process: at once, whatever threads it left behind; by an error, in any of them."""

import atexit
import os
import sys
import threading
from contextlib import suppress
from typing import Any, NoReturn

LEFT: list[threading.Thread] = []
"""Those that were not waited for any longer."""

MONITORING_TOOLS = 6
"""Those of `sys.monitoring` are numbered from 0 to 5."""


def end_process(code: Any) -> NoReturn:
    """End as `sys.exit` does, but without taking the interpreter apart, and at once while there is
    a thread that was left behind.

    That thread would abort the process if it came back while the interpreter ends: CPython ends it
    then, which a library in Rust such as Zenoh does not survive ("FATAL: exception not rethrown").

    The system takes back all memory at once: to look through modules for garbage takes a quarter of
    the processor time of a short command, and a library in C++ such as DuckDB lists what it misses.

    A profiler or debugger gets the SystemExit, as it shows its results after that.
    """
    if not any(thread.is_alive() for thread in LEFT):
        if _is_traced():
            sys.exit(code)
        threading._shutdown()  # type: ignore[attr-defined]  # as the interpreter waits for threads
    atexit._run_exitfuncs()
    if code is not None and not isinstance(code, int):
        sys.stderr.write(f"{code}\n")
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # nobody reads it, or it is closed
            stream.flush()
    os._exit(code if isinstance(code, int) else code is not None)


def _is_traced() -> bool:
    """Return whether a profiler, a debugger or the like follows this thread."""
    monitoring: Any = getattr(sys, "monitoring", None)  # Python 3.12 and later
    tools = monitoring and any(map(monitoring.get_tool, range(MONITORING_TOOLS)))
    return bool(sys.getprofile() or sys.gettrace() or tools)


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
