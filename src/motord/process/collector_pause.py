"""Imports without searches for garbage: modules make none, and each search costs time."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def collector_paused() -> Iterator[None]:
    """Switch the garbage collector off while the block imports: a sixth of its time.

    What is there at the end of the first block is left out of all later searches, the last ones of
    a process that ends included: through modules they take longest, and find nothing.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if not gc.get_freeze_count():  # later blocks of a long process may have garbage
            gc.freeze()
        if was_enabled:
            gc.enable()
