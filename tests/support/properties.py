"""How many examples a property gets."""

import os

INTERPRETED = os.environ.get("NUMBA_DISABLE_JIT") == "1"
QUICK = os.environ.get("MOTORD_HYPOTHESIS") == "quick"
FEW = 5
"""Interpreted, a few examples reach the same lines."""
SOME = 20
"""In `make quick`, and where the coverage of the firmware is measured; `make test` has them all."""


def examples(count: int) -> int:
    """Return `count`, at most `SOME` in `make quick`, `FEW` without the compiler."""
    if INTERPRETED:
        return min(count, FEW)
    return min(count, SOME) if QUICK else count
