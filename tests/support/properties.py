"""How many examples a property gets."""

import os

INTERPRETED = os.environ.get("NUMBA_DISABLE_JIT") == "1"
FEW = 5
"""Interpreted, a few examples reach the same lines."""


def examples(count: int) -> int:
    """Return `count`, or `FEW` without the compiler: for tests marked `kernel`."""
    return min(count, FEW) if INTERPRETED else count
