"""A results store: a folder of Parquet files, one a result, written whole and never changed."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from motord.results.error import ResultsError, parquet, require_parquet
from motord.results.folders.folder import folder_of
from motord.results.parquet_file import (
    NotAResultError,
    ResultFile,
    check_result,
    decode_result,
    one_table,
)
from motord.results.stored_result import StoredResult

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True)
class Added:
    """Where a result is; new: it was not in the store before."""

    path: Path | str
    figures: int
    new: bool

    def to_text(self) -> str:
        """Return what became of it, as a line."""
        if self.new:
            return f"stored {self.figures} figures in {self.path}"
        return f"duplicate result, nothing stored: it is in {self.path}"


@dataclass(frozen=True)
class Contents:
    """The rows of a store; unreadable: what could not be read, and why, a line each."""

    table: "pa.Table"
    unreadable: tuple[str, ...]


class ResultsStore:
    """The results in a folder. Any number of processes may add to it and read it at once.

    place: its path, or a URL that fsspec knows. Raises ResultsError for one that it does not.
    """

    def __init__(self, place: Path | str) -> None:
        self.folder = folder_of(place)
        self._listed: dict[str, list[str]] | None = None  # names, by digests of the analysis

    def make(self) -> None:
        """Make the folder if its parent is there. Raises ResultsError if nothing can be stored."""
        require_parquet()
        try:
            self.folder.make()
        except OSError as error:
            raise self._cannot("store results there", error) from error

    def list_once(self) -> None:
        """List the names for all that is added from now on: who adds n results lists n^2 else.

        What another process stores meanwhile is not seen; its name is the same where the result is.
        Raises OSError.
        """
        self._listed = {}
        for name in self._names():
            self._listed.setdefault(_analysis_digest(name), []).append(name)

    def add(self, result: StoredResult) -> Added:
        """Store a result as `add_file` does."""
        return self.add_file(ResultFile.of(result))

    def add_file(self, file: ResultFile) -> Added:
        """Store a result unless it is there already. Raises ResultsError; then nothing is stored.

        One is there if the same recordings were analysed by the same version and settings; one of
        an unknown version also if a result of the same recordings has exactly the same figures.
        """
        try:
            there = self._find(file)
            if there is None:
                self.folder.write(file.name, file.content)
        except OSError as error:
            raise self._cannot("store the result", error) from error
        if self._listed is not None and there is None:
            self._listed.setdefault(file.analysis_digest, []).append(file.name)
        return Added(self.folder.path_of(there or file.name), file.figures, new=there is None)

    def has(self, name: str) -> bool:
        """Return whether there is a file of this name that can be read."""
        [content] = self.folder.read([Path(name).name])
        with suppress(NotAResultError):
            if not isinstance(content, OSError):
                check_result(content)
                return True
        return False

    def read(self) -> Contents:
        """Return all rows, in the order of the files' names. Raises ResultsError."""
        parquet()
        tables, unreadable = [], []
        try:
            names = self._names()
            for name, content in zip(names, self.folder.read(names), strict=True):
                path = self.folder.path_of(name)
                if isinstance(content, OSError):
                    unreadable.append(f"{path}: {content.strerror}")
                    continue
                try:
                    tables.append(decode_result(content))
                except NotAResultError as error:
                    unreadable.append(f"{path}: {error}")
        except FileNotFoundError:
            raise ResultsError(
                f"{self.folder}: there is no results store; motord analyse ... --store makes one"
            ) from None
        except OSError as error:
            raise self._cannot("read the results store", error) from error
        return Contents(one_table(tables), tuple(unreadable))

    def _names(self) -> list[str]:
        """Return the names of results. Raises OSError."""
        names = sorted(self.folder.names())
        return [name for name in names if name.endswith(".parquet") and not name.startswith(".")]

    def _same(self, file: ResultFile) -> list[str]:
        """Return the names of files that may be of the same result. Raises OSError."""
        if self._listed is not None and file.version:
            return self._listed.get(file.analysis_digest, [])
        figures = f"-{file.content_digest}.parquet"
        return [
            name
            for name in self._names()
            if _analysis_digest(name) == file.analysis_digest
            or (not file.version and name.endswith(figures))
        ]

    def _find(self, file: ResultFile) -> str | None:
        """Return the file of a result that is there and can be read. Raises OSError."""
        try:
            same = self._same(file)
        except FileNotFoundError:  # of an object store, in which nothing has been put yet
            return None
        for name, content in zip(same, self.folder.read(same), strict=True):
            if isinstance(content, OSError):
                if not isinstance(content, FileNotFoundError | IsADirectoryError | PermissionError):
                    raise content
                continue
            with suppress(NotAResultError):
                check_result(content)
                return name
        return None

    def _cannot(self, what: str, error: OSError) -> ResultsError:
        return ResultsError(f"{self.folder}: cannot {what}: {error.strerror}")


def _analysis_digest(name: str) -> str:
    """Return the digest of the analysis in a file's name, "" for a name that has none."""
    return (["", "", *name.split("-")])[-2]
