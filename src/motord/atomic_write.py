"""Small files that are there whole or not at all, whatever interrupts the writing."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


def write_whole(path: Path, content: str | bytes, access_of: Path | None = None) -> None:
    """Write `path` in one step: a temporary file next to it, synced, then renamed. Raises OSError.

    Until then `path` holds what it held before. Who may read and write it stays, or is as of
    `access_of`; a link stays a link; a pipe or a device is written to as it is. Text is written as
    UTF-8.
    """
    if path.exists() and not path.is_file():
        path.write_bytes(_encoded(content))
        return
    with _naming(path):
        target = path.resolve()
        _replace(target, content, _status(access_of or target), synced=True)
        sync_folder(target.parent)


def write_cached(path: Path, content: str | bytes) -> None:
    """Write `path` in one step, for what can be made again: it is not synced. Raises OSError.

    Who reads it finds what was there before, or this. After a loss of power it may be neither.
    """
    with _naming(path):
        _replace(path, content, None, synced=False)


def why_not_written(path: Path, error: OSError) -> str:
    """Return why `path` cannot be written: its folder is not there, or what the system says."""
    if isinstance(error, FileNotFoundError) and not path.parent.exists():
        return f"there is no folder {path.parent}; make it"
    return error.strerror or str(error)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Have an OSError name `path`, not the temporary file or the folder that only we know of."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, why_not_written(path, error), str(path)) from error


def sync_folder(folder: Path) -> None:
    """Have the disk hold the names in a folder, where it is asked for that. Raises OSError.

    Network shares, some of them, sync files alone: EINVAL (fsync(2)).
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
    finally:
        os.close(descriptor)


def _replace(
    path: Path, content: str | bytes, before: os.stat_result | None, *, synced: bool
) -> None:
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    mode = 0o666 if before is None else before.st_mode & 0o777
    try:
        temporary.unlink(missing_ok=True)  # of a process of the same number that was killed
        with open(temporary, "xb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
            if before is not None:
                _keep_access(file.fileno(), before)
            file.write(_encoded(content))
            if synced:
                file.flush()
                os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:  # an interrupt, too
        temporary.unlink(missing_ok=True)
        raise


def _status(path: Path) -> os.stat_result | None:
    with suppress(OSError):  # there is none
        return path.stat()
    return None


def _keep_access(descriptor: int, before: os.stat_result) -> None:
    """Give a new file group, mode and owner of the one whose place it takes, as far as allowed.

    Else a daemon could not read its bench file any more after somebody else edited it by a command.
    Where the group may not be given, another one may do no more than everybody.
    """
    mode = before.st_mode & 0o777
    try:
        os.fchown(descriptor, -1, before.st_gid)
    except OSError:
        mode &= 0o707 | (mode & 0o007) << 3
    with suppress(OSError):
        os.fchmod(descriptor, mode)
        os.fchown(descriptor, before.st_uid, -1)


def _encoded(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content
