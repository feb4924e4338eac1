"""Priority of the supervisor's own thread: above other programs, below the loop.

The loop takes the torque away when the heartbeat is late, so a busy computer must not hold it up.
Threads and processes that are started later get normal priority again; one that only estimates
steps back further.
"""

import os
from contextlib import suppress
from pathlib import Path

PRIORITY = 10
NICE = -10
BACKGROUND_NICE = 10
"""A tenth of a processor beside one program of normal priority: slow, but never without any."""


def raise_priority(loop_priority: int) -> None:
    """Give the calling thread real-time priority; if that is refused, a better nice value."""
    priority = max(1, min(PRIORITY, loop_priority - 1))
    try:
        policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except PermissionError:
        with suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, 0, NICE)


def raise_threads() -> None:
    """Give the threads that run now a better nice value, if that is allowed.

    They share the interpreter's lock with the supervisor: one that holds it must not have to wait
    for other programs, or the supervisor waits with it.
    """
    for task in Path("/proc/self/task").iterdir():
        with suppress(OSError):  # refused, or ended meanwhile
            os.setpriority(os.PRIO_PROCESS, int(task.name), NICE)


def restore_priority() -> None:
    """Give the calling thread normal priority again."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def avoid_cpu(loop_cpu: int | None) -> None:
    """Let this thread, and those that it starts, run anywhere but on `loop_cpu`."""
    others = os.sched_getaffinity(0) - {loop_cpu}
    if others:
        with suppress(OSError):
            os.sched_setaffinity(0, others)


def lower_priority(loop_cpu: int | None) -> None:
    """Give all threads of this process a low priority, and not the processor `loop_cpu`."""
    others = os.sched_getaffinity(0) - {loop_cpu}
    for task in Path("/proc/self/task").iterdir():
        with suppress(OSError):  # refused, or ended meanwhile
            os.setpriority(os.PRIO_PROCESS, int(task.name), BACKGROUND_NICE)
            if others:
                os.sched_setaffinity(int(task.name), others)


def priority_text() -> str:
    """Return the priority of the main thread."""
    policy = os.sched_getscheduler(os.getpid()) & ~os.SCHED_RESET_ON_FORK
    if policy == os.SCHED_RR:
        return f"SCHED_RR {os.sched_getparam(os.getpid()).sched_priority}"
    nice = os.getpriority(os.PRIO_PROCESS, os.getpid())
    return f"nice {nice}" if nice else "normal priority"
