"""The Unix socket on which a daemon may listen: reached by the members of a group alone.

Zenoh makes the socket, takes the place of one that a dead daemon left, and refuses a path on which
another daemon listens; a lock file next to the socket tells it which is which.
"""

import os
import shutil
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from motord.api.endpoints import UNIX_SOCKET

MODE = 0o660


class SocketError(Exception):
    """No socket can be there, or others could put theirs in its place; the message says why."""


def paths(endpoints: Sequence[str]) -> list[Path]:
    """Return the paths of the Unix sockets among Zenoh endpoints."""
    return [Path(e.removeprefix(UNIX_SOCKET)) for e in endpoints if e.startswith(UNIX_SOCKET)]


@contextmanager
def owned_by(group: str | None, endpoints: Sequence[str]) -> Iterator[None]:
    """Let the sockets of `endpoints`, which are made in this block, belong to `group`.

    They are made with `MODE`; without a group they keep that of this process. Raises SocketError.
    """
    sockets = paths(endpoints)
    for path in sockets:
        check_place(path)
    before = os.umask(0o777 & ~MODE) if sockets else None
    try:
        yield
    finally:
        if before is not None:
            os.umask(before)
    for path in sockets:
        _give(path, group)


def check_place(path: Path) -> None:
    """Raise SocketError unless only this user (or root) can put something at `path`."""
    folder = path.parent
    try:
        above = folder.stat()
        there = path.lstat() if path.exists() or path.is_symlink() else None
    except OSError as error:
        raise SocketError(f"{folder}: {error.strerror}; make this folder first") from None
    if above.st_mode & (stat.S_IWGRP | stat.S_IWOTH) or above.st_uid not in (0, os.getuid()):
        raise SocketError(
            f"{folder}: others may write there, and could put a socket of theirs in the place of "
            f"{path.name}; take a folder of the daemon's own (chmod 750)"
        )
    if there is not None and not stat.S_ISSOCK(there.st_mode):
        raise SocketError(f"{path}: there is something else, which is no socket; move it away")


def _give(path: Path, group: str | None) -> None:
    if group is None:
        return
    try:
        shutil.chown(path, group=group)
    except LookupError:
        raise SocketError(f"socket_group = '{group}': there is no such group") from None
    except OSError as error:
        raise SocketError(
            f"{path}: cannot give it to socket_group = '{group}': {error.strerror}; the daemon's "
            "user must be in that group"
        ) from None
