"""A results store in an object store, or wherever else fsspec reaches by a URL.

Object stores cannot rename, but a put is atomic: a file is there whole under its name, or not. Its
name says what is in it, so whoever puts it a second time puts the same.
"""

import errno
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from motord.results.error import ResultsError, fsspec
from motord.results.parquet_file import NotAResultError, check_result

PROBE = ".motord-probe"
"""An empty file that is put and removed, to see whether results could be put."""

READ_AT_ONCE = 256
"""Files that are fetched at the same time, where the store can do that."""


class RemoteFolder:
    """A folder of a file system of fsspec; url: as it is shown, without credentials."""

    def __init__(self, file_system: Any, root: str, url: str) -> None:
        self._fs = file_system
        self._root = root.rstrip("/")
        self._url = url.rstrip("/")

    def __str__(self) -> str:
        return self._url

    def make(self) -> None:
        """See whether files can be put: before an analysis, which may take long."""
        probe = f"{self._root}/{PROBE}"
        with _as_os_errors():
            self._fs.pipe_file(probe, b"")
        with suppress(Exception):  # where nothing may be deleted it stays; it is passed over
            self._fs.rm_file(probe)

    def names(self) -> list[str]:
        """Return the names of the files."""
        with _as_os_errors():
            self._fs.invalidate_cache(self._root)
            found = self._fs.ls(self._root, detail=False)
        return [path.rstrip("/").rpartition("/")[2] for path in found]

    def read(self, names: Sequence[str]) -> Iterator[bytes | OSError]:
        """Yield content, or why it cannot be read, of each file."""
        for begin in range(0, len(names), READ_AT_ONCE):
            paths = [f"{self._root}/{name}" for name in names[begin : begin + READ_AT_ONCE]]
            with _as_os_errors():
                found = self._fs.cat(paths, on_error="return")
            contents = {path.rpartition("/")[2]: content for path, content in found.items()}
            for name in names[begin : begin + READ_AT_ONCE]:
                content = contents.get(name, FileNotFoundError())
                yield _os_error(content) if isinstance(content, Exception) else bytes(content)

    def write(self, name: str, data: bytes) -> None:
        """Put a file; what is left of one that broke off, where a put is not atomic, is removed."""
        path = f"{self._root}/{name}"
        with _as_os_errors():
            try:
                self._fs.pipe_file(path, data)
            except BaseException:
                with suppress(Exception):
                    self._remove_half(path)
                raise

    def _remove_half(self, path: str) -> None:
        try:
            check_result(self._fs.cat_file(path))
        except NotAResultError:
            self._fs.rm_file(path)

    def path_of(self, name: str) -> str:
        """Return the URL of a file."""
        return f"{self._url}/{name}"


def open_remote(url: str) -> RemoteFolder:
    """Return the folder at a URL. Raises ResultsError, also where a package is missing."""
    shown = re.sub(r"(://)[^/@]*@", r"\1", url)
    core = fsspec().core
    try:
        file_system, root = core.url_to_fs(url)
    except ImportError as error:
        raise ResultsError(f"{shown}: needs another package: {error}") from None
    except Exception as error:
        raise ResultsError(f"{shown}: cannot be a results store: {_words(error)}") from None
    if set(root) & set("*?["):
        raise ResultsError(f"{shown}: cannot be a results store: has one of the characters * ? [")
    return RemoteFolder(file_system, root, shown)


@contextmanager
def _as_os_errors() -> Iterator[None]:
    """Turn whatever a file system's own libraries raise into an OSError that says why."""
    try:
        yield
    except Exception as error:
        raise _os_error(error) from error


def _os_error(error: Exception) -> OSError:
    if isinstance(error, FileNotFoundError):
        return FileNotFoundError(errno.ENOENT, "there is no such bucket, folder or file")
    if isinstance(error, PermissionError):
        return PermissionError(errno.EACCES, _words(error))
    return OSError(errno.EIO, _words(error))


def _words(error: Exception) -> str:
    known = error.strerror if isinstance(error, OSError) else ""
    return " ".join((known or str(error)).split()) or type(error).__name__
