"""The seed of a campaign: SEED of the environment, which `make soak` draws and prints.

Without it a campaign begins where the figures of the documentation do.
"""

import os


def first(published: int = 1) -> int:
    """Return the seed; `published` if none is given."""
    return int(os.environ.get("SEED", published))


def several(count: int, published: int = 1) -> range:
    """Return so many seeds, from the seed on."""
    return range(first(published), first(published) + count)
