"""The folder of a results store: a local one, written by renaming; another one by its URL."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias
from urllib.parse import unquote, urlsplit

from motord.atomic_write import write_whole
from motord.results.error import ResultsError

if TYPE_CHECKING:
    from motord.results.folders.remote_folder import RemoteFolder

ResultsFolder: TypeAlias = "LocalFolder | RemoteFolder"
"""Files by their names; what cannot be done raises OSError, whose strerror says why."""


class LocalFolder:
    """A folder of this computer's file systems."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __str__(self) -> str:
        return str(self.path)

    def make(self) -> None:
        """Make the folder if its parent is there, and make sure that files can be written."""
        self.path.mkdir(exist_ok=True)
        probe = self.path / f".{id(self)}.probe"
        probe.touch()
        probe.unlink()

    def names(self) -> list[str]:
        """Return the names in it. Raises FileNotFoundError if it is not there."""
        with os.scandir(self.path) as entries:
            return [entry.name for entry in entries]

    def read(self, names: Sequence[str]) -> Iterator[bytes | OSError]:
        """Yield content, or why it cannot be read, of each file."""
        for name in names:
            try:
                yield (self.path / name).read_bytes()
            except OSError as error:
                yield error

    def write(self, name: str, data: bytes) -> None:
        """Write a file under another name and rename it."""
        write_whole(self.path / name, data)

    def path_of(self, name: str) -> Path:
        """Return the path of a file."""
        return self.path / name


def folder_of(place: Path | str) -> ResultsFolder:
    """Return the folder at a path or URL; `file:` is a local one. Raises ResultsError."""
    text = str(place)
    if isinstance(place, Path) or "://" not in text:
        return LocalFolder(Path(place))
    url = urlsplit(text)
    if url.scheme == "file":
        if url.netloc not in ("", "localhost"):
            raise ResultsError(f"{text}: of another computer; a local folder is file:///FOLDER")
        return LocalFolder(Path(unquote(url.path)))
    from motord.results.folders.remote_folder import open_remote

    return open_remote(text)
