"""How many threads numerical libraries compute with: one, in every process of motord.

They read the variables when they are loaded, so these are set before. Sums depend in their last
bits on how many threads share them, and the loop's process has no thread but its own.
"""

from collections.abc import Mapping

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment variables; those that Dask's nannies set, too."""


def missing_limits(environment: Mapping[str, str]) -> dict[str, str]:
    """Return those of `ONE_THREAD` that an environment does not have, or with another value."""
    return {name: one for name, one in ONE_THREAD.items() if environment.get(name) != one}
