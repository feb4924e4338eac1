"""File operations that are broken off, fail, or do only part, at the n-th of them; and power cuts.

After a kill nothing of the program runs any more: every further operation fails, those of `finally`
too. A power cut takes away, besides, what was written and not synced.
"""

import errno
import io
import os
import pathlib
from contextlib import contextmanager
from unittest import mock

OPERATIONS = (
    *("open", "read", "write", "fsync", "ftruncate", "link", "unlink", "rename"),
    *("replace", "mkdir"),
)
CHANGING = ("open", "write", "fsync", "ftruncate", "link", "unlink", "rename", "replace", "mkdir")


class Killed(BaseException):
    """The process is no more."""


class FaultyDisk:
    """Does `fault` at operation number `at` below `folder`: kill, cut, short, or an errno."""

    def __init__(self, at, fault):
        self.at, self.fault = at, fault
        self.count, self.dead = 0, False
        self._real = {name: getattr(os, name) for name in OPERATIONS}
        self._dirty = set()  # inodes of files written to since they were synced

    @contextmanager
    def __call__(self):
        patches = [mock.patch.object(os, name, self._doing(name)) for name in OPERATIONS]
        patches.append(mock.patch.object(pathlib.Path, "open", self._path_open()))
        for patch in patches:
            patch.start()
        try:
            yield self
        finally:
            for patch in reversed(patches):
                patch.stop()

    def _doing(self, name):
        real = self._real[name]

        def do(*args, **named):
            self._step(name)
            short = self.fault == "short" and self.count == self.at and name == "write"
            if short:
                args = (args[0], bytes(args[1])[: max(1, len(args[1]) // 2)])
            result = None if name == "fsync" else real(*args, **named)
            self._note(name, args, result)
            return result

        return do

    def _path_open(self):
        real = pathlib.Path.open

        def open_path(path, mode="r", *args, **named):
            self._step("open")
            if mode != "wb":
                return real(path, mode, *args, **named)
            return _Written(self, real(path, mode, *args, **named))

        return open_path

    def _step(self, name):
        self.count += 1
        if self.dead:
            raise Killed
        if self.count == self.at and self.fault in ("kill", "cut"):
            self.dead = True
            raise Killed
        changes = name in CHANGING if self.fault == errno.ENOSPC else True
        if self.count == self.at and isinstance(self.fault, int) and changes:
            raise OSError(self.fault, os.strerror(self.fault))

    def _note(self, name, args, result):
        if name == "write":
            self._dirty.add(os.fstat(args[0]).st_ino)
        elif name == "fsync":
            self._dirty.discard(os.fstat(args[0]).st_ino)

    def lose_unsynced(self, folder):
        """Empty what was not synced, as after a power cut."""
        for path in pathlib.Path(folder).rglob("*"):
            if path.is_file() and path.stat().st_ino in self._dirty:
                os.truncate(path, 0)


class _Written(io.RawIOBase):
    """A file opened by `Path.open("wb")`, whose writing is an operation, too."""

    def __init__(self, disk, file):
        self._disk, self._file = disk, file

    def writable(self):
        return True

    def fileno(self):
        return self._file.fileno()

    def write(self, data):
        left = memoryview(data)
        while left:
            left = left[os.write(self._file.fileno(), left) :]
        return len(data)

    def close(self):
        self._file.close()
        super().close()
