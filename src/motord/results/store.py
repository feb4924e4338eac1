"""A results store: a folder of Parquet files, one a result, written whole and never changed."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from motord.atomic_write import write_whole
from motord.results.error import ResultsError, parquet
from motord.results.parquet_file import (
    NotAResultError,
    check_result,
    decode_result,
    encode_result,
    table_schema,
)
from motord.results.stored_result import StoredResult

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True)
class Added:
    """Where a result is; new: it was not in the store before."""

    path: Path
    figures: int
    new: bool

    def in_words(self) -> str:
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
    """The results in a folder. Any number of processes may add to it and read it at once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def make(self) -> None:
        """Make the folder if its parent is there. Raises ResultsError if nothing can be stored."""
        parquet()
        try:
            self.folder.mkdir(exist_ok=True)
            probe = self.folder / f".{id(self)}.probe"
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise self._cannot("store results there", error) from error

    def add(self, result: StoredResult) -> Added:
        """Store a result unless it is there already. Raises ResultsError; then nothing is stored.

        One is there if the same recordings were analysed by the same version and settings; one of
        an unknown version also if a result of the same recordings has exactly the same figures.
        """
        if not result.figures:
            raise ResultsError(f"{result.experiment} of {result.run}: no figures to store")
        path = self.folder / result.file_name
        there = self._find(result)
        if there is None:
            try:
                write_whole(path, encode_result(result))
            except OSError as error:
                raise self._cannot("store the result", error) from error
        return Added(there or path, len(result.figures), new=there is None)

    def has(self, name: str) -> bool:
        """Return whether there is a file of this name that can be read."""
        return self._readable(self.folder / Path(name).name)

    def read(self) -> Contents:
        """Return all rows, in the order of the files' names. Raises ResultsError."""
        parquet()
        import pyarrow as pa

        tables, unreadable = [table_schema().empty_table()], []
        for path in self._files():
            try:
                tables.append(decode_result(path.read_bytes()))
            except OSError as error:
                unreadable.append(f"{path}: {error.strerror}")
            except NotAResultError as error:
                unreadable.append(f"{path}: {error}")
        return Contents(pa.concat_tables(tables), tuple(unreadable))

    def _files(self) -> Iterator[Path]:
        parquet()
        try:
            names = sorted(path.name for path in self.folder.iterdir())
        except FileNotFoundError:
            raise ResultsError(
                f"{self.folder}: there is no results store; motord analyse ... --store makes one"
            ) from None
        except OSError as error:
            raise self._cannot("read the results store", error) from error
        for name in names:
            if name.endswith(".parquet") and not name.startswith("."):
                yield self.folder / name

    def _find(self, result: StoredResult) -> Path | None:
        """Return the file of a result that is there and can be read."""
        of_analysis = result.analysis_digest
        of_content = result.content_digest if not result.version else None
        for path in self._files():
            analysis, content = ["", "", *path.stem.split("-")][-2:]
            if (analysis == of_analysis or content == of_content) and self._readable(path):
                return path
        return None

    @staticmethod
    def _readable(path: Path) -> bool:
        try:
            check_result(path.read_bytes())
        except (OSError, NotAResultError):
            return False
        return True

    def _cannot(self, what: str, error: OSError) -> ResultsError:
        return ResultsError(f"{self.folder}: cannot {what}: {error.strerror}")
