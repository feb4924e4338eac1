"""A results store: a folder of Parquet files, one a result, written whole and never changed."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from motord.results.error import ResultsError, parquet
from motord.results.folders.folder import folder_of
from motord.results.parquet_file import (
    NotAResultError,
    check_result,
    decode_result,
    encode_result,
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

    def make(self) -> None:
        """Make the folder if its parent is there. Raises ResultsError if nothing can be stored."""
        parquet()
        try:
            self.folder.make()
        except OSError as error:
            raise self._cannot("store results there", error) from error

    def add(self, result: StoredResult, encoded: bytes | None = None) -> Added:
        """Store a result unless it is there already. Raises ResultsError; then nothing is stored.

        encoded: its file, where that has been made already (`parquet_file.encode_result`).
        One is there if the same recordings were analysed by the same version and settings; one of
        an unknown version also if a result of the same recordings has exactly the same figures.
        """
        if not result.figures:
            raise ResultsError(f"{result.experiment} of {result.run}: no figures to store")
        try:
            there = self._find(result)
            if there is None:
                self.folder.write(result.file_name, encoded or encode_result(result))
        except OSError as error:
            raise self._cannot("store the result", error) from error
        path = self.folder.path_of(there or result.file_name)
        return Added(path, len(result.figures), new=there is None)

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

    def _find(self, result: StoredResult) -> str | None:
        """Return the file of a result that is there and can be read. Raises OSError."""
        parquet()
        analysis = f"-{result.analysis_digest}-"
        figures = f"-{result.content_digest}.parquet"
        try:
            names = self._names()
        except FileNotFoundError:  # of an object store, in which nothing has been put yet
            return None
        by_figures = not result.version
        same = [one for one in names if analysis in one or (by_figures and one.endswith(figures))]
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
