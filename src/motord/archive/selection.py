"""Which recordings of a folder are whole, which are being written, which need recovery."""

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from motord.archive.pace import ArchiveError
from motord.recording.file_names import PART
from motord.recording.mcap.mcap_file import try_lock
from motord.recording.mcap.records import MAGIC

FOLDERS = ("", "blackbox")
"""Where recordings are, below `[recording] directory`."""
CLOSING = ".closing.mcap"
"""End of the name of a file that a daemon is about to put in the place of an unfinished one."""

FRESH_S = 2.0
"""A recorder writes several times a second, and locks its file just after it has made it."""


@dataclass
class Selection:
    """Recordings of a folder by their paths below it, in the order of their names."""

    whole: list[str] = field(default_factory=list)
    being_written: list[str] = field(default_factory=list)
    unfinished: list[str] = field(default_factory=list)
    """No process writes them any more: the next daemon closes them, or `motord record recover`."""


def select(source: Path) -> Selection:
    """Look through a folder of recordings. Raises ArchiveError if it cannot be read."""
    found = Selection()
    try:
        if not source.is_dir():
            raise ArchiveError(f"{source}: no folder of recordings")
        for name in _names(source):
            path = source / name
            if not name.endswith(PART):
                (found.whole if _ends_whole(path) else found.unfinished).append(name)
            elif _is_locked(path):
                found.being_written.append(name)
            elif path.exists():  # else it has just got its final name
                found.unfinished.append(name)
    except OSError as error:
        where = error.filename or source
        raise ArchiveError(f"{where}: cannot read it: {error.strerror or error}") from error
    return found


def _names(source: Path) -> Iterator[str]:
    for folder in FOLDERS:
        place = source / folder
        if not place.is_dir():
            continue
        for path in sorted(place.iterdir()):
            own = not path.name.startswith(".") and not path.name.endswith(
                (CLOSING, CLOSING + PART)
            )
            if own and path.name.endswith((".mcap", ".mcap" + PART)) and path.is_file():
                yield str(path.relative_to(source))


def _ends_whole(path: Path) -> bool:
    """Return whether a file ends as a closed recording does; True if it is gone meanwhile."""
    try:
        with path.open("rb") as file:
            file.seek(0, os.SEEK_END)
            if file.tell() < 2 * len(MAGIC):
                return False
            file.seek(-len(MAGIC), os.SEEK_END)
            return file.read() == MAGIC
    except FileNotFoundError:
        return True


def _is_locked(path: Path) -> bool:
    """Return whether a process writes a file; one just written to is not touched to find out."""
    try:
        if abs(time.time() - path.stat().st_mtime) < FRESH_S:  # later: the clock was set back
            return True
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    try:
        return not try_lock(descriptor)
    finally:
        os.close(descriptor)
