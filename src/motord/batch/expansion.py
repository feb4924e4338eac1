"""Which recordings are meant by files, folders and patterns."""

import glob
import os
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from motord.batch.error import BatchError


def names_many(path: Path) -> bool:
    """Return whether a path is a folder or, unless there is a file of that name, a pattern."""
    return path.is_dir() or (glob.has_magic(str(path)) and not path.exists())


def expand(given: Sequence[Path]) -> list[Path]:
    """Return the recordings, each once: of a folder every .mcap below it, of a pattern its files.

    In the order given, those of one folder or pattern by name, without hidden ones. A link to a
    file that is there as well is no second one. Raises BatchError where there are none.
    """
    found: dict[str, Path] = {}
    for one in given:
        paths = _expanded(one)
        if not paths:
            raise BatchError(f"{one}: no recordings there")
        for path in paths:
            found.setdefault(os.path.realpath(path), path)
    return list(found.values())


def _expanded(path: Path) -> list[Path]:
    if not names_many(path):
        return [path]
    if path.is_dir():
        found = path.rglob("*.mcap")
    else:
        fixed = list(takewhile(lambda part: not glob.has_magic(part), path.parts))
        found = Path(*fixed).glob(str(Path(*path.parts[len(fixed) :])))
    return sorted(one for one in found if one.is_file() and not one.name.startswith("."))
