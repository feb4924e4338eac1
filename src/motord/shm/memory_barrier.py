"""Order of memory accesses between processes.

CPython executes one store after the other, and x86-64 shows them to other cores in that order.
Other processors (ARM) may reorder them, so there a compiled barrier separates the data from
the counter that announces them.
"""

import platform
from collections.abc import Callable
from typing import Any, cast

STRONGLY_ORDERED = ("x86_64", "amd64", "i686")


def compiled_barrier() -> Callable[[], None]:
    """Return a function that executes a full memory barrier; compiles it (about a second)."""
    from numba import njit, types
    from numba.extending import intrinsic

    def typing(_context: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
            builder.fence("seq_cst")
            return context.get_dummy_value()

        return types.void(), generate

    instruction = cast("Callable[[], None]", intrinsic(typing))

    @njit("void()")
    def memory_barrier() -> None:
        instruction()

    return cast("Callable[[], None]", memory_barrier)


def _nothing() -> None:
    """The barrier of a strongly ordered processor."""


def barrier_for(machine: str) -> Callable[[], None]:
    """Return what separates two shared-memory accesses on a processor (`platform.machine()`)."""
    return _nothing if machine.lower() in STRONGLY_ORDERED else compiled_barrier()


memory_barrier = barrier_for(platform.machine())
"""Everything written (read) before this call is seen (was read) before what comes after it."""
