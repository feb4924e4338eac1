"""Memory that the C library keeps after it was freed; nothing is done where that is not glibc."""

import ctypes

_M_TRIM_THRESHOLD, _M_ARENA_MAX = -1, -8  # malloc.h
_TRIM_BYTES = 128 << 10
"""What the C library begins with."""
_libc = ctypes.CDLL(None)


def allocate_from_one_heap() -> None:
    """Keep the C library from making a heap for each thread that allocates from now on.

    Each would keep the most that was ever needed of it.
    """
    if mallopt := getattr(_libc, "mallopt", None):
        mallopt(_M_ARENA_MAX, 1)


def shrink_heaps_from_their_end() -> None:
    """Keep the C library from leaving ever more free at the end of each thread's heap.

    By itself it leaves up to twice the largest block that was mapped alone and freed, 64 MiB at
    most, and takes blocks of that size from the heaps, too. From their end `malloc_trim` shrinks
    the first heap alone.
    """
    if mallopt := getattr(_libc, "mallopt", None):
        mallopt(_M_TRIM_THRESHOLD, _TRIM_BYTES)


def return_free_memory() -> None:
    """Give the system back what is free in every heap, also below what is in use.

    By itself a heap shrinks from its end alone: a small piece there keeps all before it. Takes 10
    us where there is nothing to return and 2 ms for 30 MB in small pieces, for which other threads
    that allocate from the same heap wait.
    """
    if malloc_trim := getattr(_libc, "malloc_trim", None):
        malloc_trim(0)
