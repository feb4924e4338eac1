"""Files mapped by several processes: a header of 64-bit words, then records.

A file is made under another name and moved into place, so nobody ever maps half a file, and what
a crashed process left behind is replaced while those who still map the old one keep it.
"""

import hashlib
import mmap
import os
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

HEADER_BYTES = 4096
LINE_WORDS = 8
"""Words in a cache line: counters with different writers are at least this far apart."""

_MAGIC, _LAYOUT = 0, 1
FIRST_WORD = 2


class SharedFileError(Exception):
    """A shared file that is absent, of another kind or of another version of motord."""


def as_bytes(records: np.ndarray) -> memoryview:
    """Return the memory of contiguous `records` as bytes: copied at once, not field by field."""
    return memoryview(records.view(np.uint8).data).cast("B")


@lru_cache(maxsize=8)
def layout_digest(dtype: np.dtype[np.void]) -> int:
    """Return a 63-bit digest of names, types and offsets of all fields."""
    text = "\n".join(f"{name} {field[:2]}" for name, field in (dtype.fields or {}).items())
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little") >> 1


def magic_number(kind: str) -> int:
    """Return the first word of a file of this kind (at most 7 letters)."""
    return int.from_bytes(kind.encode().ljust(7, b"\0"), "little")


class SharedFile:
    """A mapped file: `words` is its header as 64-bit integers, `memory` all of it.

    The mapping lives as long as anything refers to it, arrays over it included.
    """

    def __init__(self, path: Path, memory: mmap.mmap, inode: int) -> None:
        self.path = path
        self.memory = memory
        self.words = memoryview(memory)[:HEADER_BYTES].cast("q")
        self._inode = inode

    @classmethod
    def create(
        cls, path: Path, kind: str, layout: int, words: Sequence[int], size: int
    ) -> "SharedFile":
        """Make a zeroed file of `size` bytes after the header, with `words` from FIRST_WORD on.

        Raises SharedFileError if there is no room for it.
        """
        temporary = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            memory, inode = _map_new(temporary, HEADER_BYTES + size)
            shared = cls(path, memory, inode)
            for place, word in enumerate(words, start=FIRST_WORD):
                shared.words[place] = word
            shared.words[_LAYOUT] = layout
            shared.words[_MAGIC] = magic_number(kind)
            temporary.rename(path)
        except OSError as error:
            temporary.unlink(missing_ok=True)
            raise SharedFileError(
                f"{path}: cannot make a shared file of {size / 1e6:.1f} MB: {error.strerror}"
            ) from error
        return shared

    @classmethod
    def attach(cls, path: Path, kind: str, layout: int, *, writable: bool = False) -> "SharedFile":
        """Map an existing file. Raises SharedFileError if it is not of this kind and layout."""
        try:
            descriptor = os.open(path, os.O_RDWR if writable else os.O_RDONLY)
        except OSError as error:
            raise SharedFileError(f"{path}: cannot open it: {error.strerror}") from error
        try:
            status = os.fstat(descriptor)
            if status.st_size < HEADER_BYTES:
                raise SharedFileError(f"{path}: not a {kind} file: only {status.st_size} bytes")
            protection = mmap.PROT_READ | (mmap.PROT_WRITE if writable else 0)
            memory = mmap.mmap(descriptor, 0, mmap.MAP_SHARED | mmap.MAP_POPULATE, protection)
        except OSError as error:
            raise SharedFileError(f"{path}: cannot map it: {error.strerror}") from error
        finally:
            os.close(descriptor)
        shared = cls(path, memory, status.st_ino)
        if shared.words[_MAGIC] != magic_number(kind):
            raise SharedFileError(f"{path}: not a {kind} file")
        if shared.words[_LAYOUT] != layout:
            raise SharedFileError(
                f"{path}: its records are laid out by another version of motord; "
                "restart everything that uses this bench"
            )
        return shared

    def array(self, dtype: np.dtype[np.void], count: int, offset: int) -> np.ndarray:
        """Return `count` elements that start `offset` bytes after the header, as a view.

        Raises SharedFileError if the file ends before: read there, the mapping would end the
        process (SIGBUS), as it does if a file is made shorter while it is mapped.
        """
        if not 0 < count * dtype.itemsize <= len(self.memory) - HEADER_BYTES - offset:
            size = len(self.memory)
            raise SharedFileError(f"{self.path}: cut short: only {size} bytes are left of it")
        return np.frombuffer(self.memory, dtype, count, HEADER_BYTES + offset)

    def superseded(self) -> bool:
        """Return whether the path now names another file (or none): its writer started anew."""
        try:
            return self.path.stat().st_ino != self._inode
        except FileNotFoundError:
            return True


def _map_new(path: Path, size: int) -> tuple[mmap.mmap, int]:
    """Make a zeroed file of `size` bytes, all of it in memory; return mapping and inode."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600)
    try:
        os.posix_fallocate(descriptor, 0, size)
        memory = mmap.mmap(descriptor, 0, mmap.MAP_SHARED | mmap.MAP_POPULATE)
        return memory, os.fstat(descriptor).st_ino
    finally:
        os.close(descriptor)
