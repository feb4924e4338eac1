"""One file copied: its final name stands for a whole copy that was read back, or for nothing.

A copy grows under a temporary name of its own. A later attempt goes on where an earlier one was
broken off, as far as the two files agree. When all is written and synced it is read back from the
disk; only if its SHA-256 is that of the source it gets its final name, which replaces nothing.
"""

import errno
import hashlib
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from motord.archive.pace import ArchiveError, ConflictError, Pace
from motord.atomic_write import sync_folder
from motord.recording.mcap.mcap_file import try_lock

PARTIAL = ".partial"
_NO_LINKS = (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EINVAL)
"""Of file systems that know no hard links, such as exFAT or some shares."""


def partial_of(source: Path, copy: Path) -> Path:
    """Return the temporary name of a copy: the same for this source, another for any other."""
    origin = f"{socket.gethostname()}:{source.absolute()}"
    tag = hashlib.sha256(os.fsencode(origin)).hexdigest()[:12]
    return copy.with_name(f".{copy.name}.{tag}{PARTIAL}")


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name the file in an OSError that does not, as those of reading and writing."""
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno is not None:
            raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
        raise


def sha256_of(path: Path, pace: Pace) -> str:
    """Return the SHA-256 of a file as the disk has it. Raises OSError, PausedError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)  # from the disk, not memory
        digest = hashlib.sha256()
        with naming(path):
            while piece := _read(descriptor, pace):
                digest.update(piece)
        return digest.hexdigest()
    finally:
        os.close(descriptor)


def copy_verified(source: Path, copy: Path, pace: Pace) -> str:
    """Copy `source` to the new file `copy`; return its SHA-256.

    Raises ConflictError if `copy` exists or the source changes meanwhile, ArchiveError if what is
    read back is not what was written, PausedError, OSError.
    """
    partial = partial_of(source, copy)
    before = _signature(source)
    digest = _fill(source, partial, pace)
    if _signature(source) != before:
        raise ConflictError(f"{source}: changed while it was copied; it is tried again")
    if sha256_of(partial, pace) != digest:
        partial.unlink()
        raise ArchiveError(
            f"{copy}: what is read back there is not what was written; check this disk"
        )
    _publish(partial, copy)
    return digest


def _fill(source: Path, partial: Path, pace: Pace) -> str:
    """Make the temporary file equal to the source, and sync it; return the source's SHA-256."""
    digest = hashlib.sha256()
    reading = os.open(source, os.O_RDONLY | os.O_CLOEXEC)
    try:
        mode = os.fstat(reading).st_mode & 0o777 | 0o600
        writing = os.open(partial, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, mode)
        try:
            if not try_lock(writing):
                raise ConflictError(f"{source}: another `motord archive` copies it now")
            with suppress(OSError):  # of a share without modes
                os.fchmod(writing, mode)
            agrees = True
            while True:
                with naming(source):
                    piece = _read(reading, pace)
                if not piece:
                    break
                digest.update(piece)
                with naming(partial):
                    agrees = agrees and _agrees(writing, piece, pace)
                    if not agrees:
                        _write(writing, piece, pace)
            with naming(partial):
                os.ftruncate(writing, os.lseek(writing, 0, os.SEEK_CUR))
                os.fsync(writing)
        finally:
            os.close(writing)
    finally:
        os.close(reading)
    return digest.hexdigest()


def _agrees(descriptor: int, piece: bytes, pace: Pace) -> bool:
    """Return whether the file goes on with `piece`; if not it stands where this should be."""
    place = os.lseek(descriptor, 0, os.SEEK_CUR)
    pace.spend(min(len(piece), os.fstat(descriptor).st_size - place))
    there = os.read(descriptor, len(piece))
    if there == piece:
        return True
    os.lseek(descriptor, place, os.SEEK_SET)
    os.ftruncate(descriptor, place)
    return False


def _read(descriptor: int, pace: Pace) -> bytes:
    piece = os.read(descriptor, pace.chunk_bytes)
    pace.spend(len(piece))
    return piece


def _write(descriptor: int, piece: bytes, pace: Pace) -> None:
    pace.spend(len(piece))
    left = memoryview(piece)
    while left:
        left = left[os.write(descriptor, left) :]


def _publish(partial: Path, copy: Path) -> None:
    """Give a copy its final name, unless there is a file of that name. Raises ConflictError."""
    taken = ConflictError(
        f"{copy}: there is another file of this name already; it is left alone. Remove or rename "
        "it, or archive to another folder"
    )
    try:
        os.link(partial, copy)
    except FileExistsError:
        raise taken from None
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        if os.path.lexists(copy):
            raise taken from None
        partial.rename(copy)
    else:
        sync_folder(copy.parent)
        partial.unlink()
    sync_folder(copy.parent)


def _signature(path: Path) -> tuple[int, int, int, int]:
    status = path.stat()
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns
