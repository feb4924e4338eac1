"""Folders in the home of this user, who may have none: in a container, or as a service."""

import errno
import os
from pathlib import Path


def in_home(variable: str, *parts: str) -> Path:
    """Return the folder that a variable of the environment names, else `parts` below the home.

    Raises OSError, which says what to do, if there is neither.
    """
    if named := os.environ.get(variable):
        return Path(named)
    try:
        return Path.home().joinpath(*parts)
    except RuntimeError:  # neither HOME nor an account of this number
        why = f"this user has no home; let {variable} name a folder that it may write to"
        raise OSError(errno.ENOENT, why, "~") from None
