"""Imports without searches for garbage: modules make none, and each search costs time."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def collector_paused() -> Iterator[None]:
    """Switch the garbage collector off while the block imports: a sixth of its time.

    What is there at the end of a block that imported something is left out of all later searches,
    the last ones of a process that ends included: through modules they take longest.
    """
    was_enabled, before = gc.isenabled(), len(sys.modules)
    gc.disable()
    try:
        yield
    finally:
        if len(sys.modules) > before:  # else it is one of many, in a process that has garbage
            gc.freeze()
        if was_enabled:
            gc.enable()
