"""How many examples a property gets, and which of many combinations `make quick` leaves out."""

import os

import pytest
from _pytest.mark import ParameterSet

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


def slow(*values: object) -> list[ParameterSet]:
    """Return values for combinations that repeat what others show, and are left to `make test`."""
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]
