"""The folder in memory that is this user's alone: of shared files, locks and sockets."""

import os
import stat
from pathlib import Path


class PrivateFolderError(Exception):
    """A folder that others could use, or that cannot be made."""


def base_directory() -> Path:
    """Return `$XDG_RUNTIME_DIR/motord`, or `/dev/shm/motord-<uid>` without such a directory."""
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / "motord"
    return Path(f"/dev/shm/motord-{os.getuid()}")


def make_private(folder: Path) -> None:
    """Make `folder`, this user's alone, with those above it. Raises PrivateFolderError."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.lstat()
        if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
            raise PrivateFolderError(
                f"{folder}: belongs to another user or is no folder; remove it"
            )
        if stat.S_IMODE(status.st_mode) != 0o700:
            folder.chmod(0o700)
    except OSError as error:
        raise PrivateFolderError(
            f"{folder}: cannot make it: {error.strerror}; let XDG_RUNTIME_DIR name a folder in "
            "memory that this user may write to"
        ) from error
