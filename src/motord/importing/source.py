"""A source of rows as the import sees it: columns by name, blocks of values, what is wrong."""

import difflib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motord.findings import listed
from motord.importing.mapping import Column
from motord.recording.errors import RecordError

LINES_NAMED = 5
"""Lines that are named of each kind."""

LEFT_OUT = ": left out"
"""How a kind ends of which the rows are not used."""

BLOCK_ROWS = 1 << 16
"""Rows that are read at once."""

MISSING_NS = np.iinfo(np.int64).min
"""Time of a row that has none, where times are whole ns."""


class Problems:
    """Counts what is wrong, by kind; `unit` is what a row's number counts: line or row."""

    def __init__(self, unit: str) -> None:
        self.unit = unit
        self._lines: dict[str, list[int]] = {}
        self._counts: dict[str, int] = {}

    def add(self, kind: str, lines: np.ndarray) -> None:
        """Note that rows `lines` (n,) are of this kind, which says what becomes of them."""
        if lines.size:
            named = self._lines.setdefault(kind, [])
            named += lines[: LINES_NAMED - len(named)].tolist()
            self._counts[kind] = self._counts.get(kind, 0) + lines.size

    def __bool__(self) -> bool:
        return bool(self._counts)

    def count(self, kind: str) -> int:
        """Return how many rows are of this kind."""
        return self._counts.get(kind, 0)

    @property
    def left_out(self) -> int:
        """How many rows are not used."""
        return sum(n for kind, n in self._counts.items() if kind.endswith(LEFT_OUT))

    def messages(self) -> Iterator[str]:
        """Yield each kind on a line."""
        for kind, count in self._counts.items():
            named = self._lines[kind]
            more = f" and {count - len(named)} more" if count > len(named) else ""
            plural = self.unit if count == 1 else self.unit + "s"
            yield f"{plural} {', '.join(map(str, named))}{more}: {kind}"

    def to_json(self) -> list[dict[str, Any]]:
        """Return kinds with counts and first lines."""
        return [
            {"what": kind, "count": count, f"first_{self.unit}s": self._lines[kind]}
            for kind, count in self._counts.items()
        ]


@dataclass(frozen=True)
class WantedColumn:
    """A column, by its index from 0 on; as_time: as whole Unix ns, otherwise as numbers."""

    index: int
    as_time: bool = False


@dataclass(frozen=True)
class RawBlock:
    """Rows as they are in the source: n of them.

    columns: of each wanted column values (n,), float64 with nan where there is none, or int64 with
    MISSING_NS; row (n,): the number of each row, from 1 on, those left out counted; line (n,): its
    number for messages; done: share of the source, 0 to 1.
    """

    columns: tuple[np.ndarray, ...]
    row: np.ndarray
    line: np.ndarray
    done: float


@dataclass(frozen=True)
class RowClock:
    """The time of rows that follows from their number: Unix ns of the first, None if unknown."""

    start_ns: int | None
    period_s: float


class RowSource(ABC):
    """A file with columns of values.

    unit: what `RawBlock.line` counts, line or row; names: of the columns, "" for one without;
    notes: what was found out about the file, as text; times_of_day: dates begin anew at midnight.
    """

    unit = "row"
    times_of_day = False
    path: Path
    names: tuple[str, ...]
    notes: list[str]

    def places(self, name: str) -> list[int]:
        """Return the index of each column that `name` may mean."""
        return [index for index, known in enumerate(self.names) if known == name]

    def row_clock(self, columns: Sequence[int]) -> RowClock | None:
        """Return the clock that the file gives for these columns, None if it gives none."""
        return None

    def fix_rows(self, columns: Sequence[int]) -> None:  # noqa: B027
        """Let a row be what all these columns have."""

    @abstractmethod
    def holds_dates(self, index: int) -> bool:
        """Return whether a column holds dates rather than numbers."""

    @abstractmethod
    def holds_whole_numbers(self, index: int) -> bool:
        """Return whether a column holds whole numbers, too long perhaps for a float."""

    @abstractmethod
    def blocks(self, wanted: Sequence[WantedColumn], problems: Problems) -> Iterator[RawBlock]:
        """Yield all rows, at most about BLOCK_ROWS at once; rows without cells are noted."""


class ColumnSource(RowSource):
    """A file of channels in groups, each with `name` and `group_name`, and a number of rows.

    _group: where channels named without their group are looked for, None: in all.
    """

    _group: str | None
    _channels: Sequence[Any]
    _rows: int

    def places(self, name: str) -> list[int]:
        """Return the index of each channel that is Group/Channel, or has that name in its group."""
        return super().places(name) or [
            index
            for index, channel in enumerate(self._channels)
            if channel.name == name and self._group in (None, channel.group_name)
        ]

    def holds_whole_numbers(self, index: int) -> bool:
        """Return whether a channel holds whole numbers."""
        return self._dtype(index).kind in "iu"

    def blocks(self, wanted: Sequence[WantedColumn], problems: Problems) -> Iterator[RawBlock]:
        """Yield all rows."""
        for start in range(0, self._rows, BLOCK_ROWS):
            count = min(BLOCK_ROWS, self._rows - start)
            columns = tuple(self._read(w, start, count) for w in wanted)
            row = np.arange(start + 1, start + count + 1)
            yield RawBlock(columns, row, row, (start + count) / self._rows)

    @abstractmethod
    def _dtype(self, index: int) -> "np.dtype[Any]": ...

    @abstractmethod
    def _read(self, wanted: WantedColumn, start: int, count: int) -> np.ndarray: ...


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Make a RecordError of an OSError of the body, which reads `path`."""
    try:
        yield
    except OSError as error:
        raise RecordError(f"{path}: cannot read it: {error.strerror or error}") from error


@contextmanager
def readable_as(path: Path, kind: str) -> Iterator[None]:
    """Make a RecordError of whatever a damaged file makes the package of its format raise."""
    try:
        with readable(path):
            yield
    except RecordError:
        raise
    except Exception as error:
        raise RecordError(
            f"{path}: not {kind} file that can be read ({type(error).__name__}: {error})"
        ) from error


def find(source: RowSource, field: str, column: Column) -> int:
    """Return the index of the column that is to become `field`. Raises RecordError."""
    if column.position is not None:
        if column.position > len(source.names):
            raise RecordError(
                f"{source.path}: {field}: there is no column {column.position}, "
                f"the file has {len(source.names)}"
            )
        return column.position - 1
    index = locate(source, column.column)
    if index is None:
        raise RecordError(
            f"{source.path}: {field}: there is no column {column.column!r}"
            + suggestion(column.column, source.names)
        )
    return index


def locate(source: RowSource, name: str) -> int | None:
    """Return the index of the column `name`, None if there is none. Raises RecordError."""
    found = source.places(name.strip())
    if len(found) > 1:
        places = ", ".join(str(index + 1) for index in found)
        raise RecordError(
            f"{source.path}: there are {len(found)} columns {name!r} (columns {places}); "
            "give the position of the one that is meant"
        )
    return found[0] if found else None


def suggestion(name: str, names: Sequence[str]) -> str:
    """Return as text which of `names` may have been meant."""
    folded = {known.casefold(): known for known in names if known}
    near = difflib.get_close_matches(name.casefold(), list(folded), 3, 0.4)
    if near:
        return "; did you mean " + " or ".join(repr(folded[n]) for n in near) + "?"
    named = [repr(known) for known in names if known]
    if not named:
        return "; the columns have no names, give their positions: 1 for the first"
    return f"; it has {listed(named, 20, ', ')}"
