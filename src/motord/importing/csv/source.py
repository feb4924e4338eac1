"""CSV as a source of rows, a few thousand lines at a time.

Lines become columns of numbers: all at once where they are clean, else cell by cell.
"""

import io
import re
import warnings
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from motord.importing.csv.dialect import (
    Dialect,
    detect,
    is_row,
    number,
    split_line,
    without_blank_end,
)
from motord.importing.dates import MIDNIGHT, date_of, is_time_of_day
from motord.importing.mapping import CsvMap
from motord.importing.source import (
    LEFT_OUT,
    MISSING_NS,
    Problems,
    RawBlock,
    RowSource,
    WantedColumn,
)
from motord.recording.errors import RecordError

Columns = tuple[np.ndarray, ...]

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
GROUPED = re.compile(r"[+-]?\d{1,3}([,.' \u00a0\u202f])\d{3}(?:\1\d{3})*(?:[.,]\d*)?")
"""Numbers with thousands separators, among others."""
POINTED = r"\s*[+-]?\d{1,3}(?:\.\d{3})+\s*"
"""Those of points alone."""

BLOCK_CHARACTERS = 1 << 21
"""Text that is read at once."""

LINE_MAX = 1 << 20
"""Characters of the longest line of a table."""


class CellReader:
    """Reads the columns `wanted`; those whose index is in `dates` hold dates in `date_format`.

    path: the file, for what is refused.
    """

    def __init__(
        self,
        path: Path,
        dialect: Dialect,
        wanted: tuple[WantedColumn, ...],
        dates: tuple[int, ...],
        date_format: str | None,
    ) -> None:
        self._path = path
        self._dialect = dialect
        self._wanted = wanted
        self._dates = dates
        self._date_format = date_format
        self._swap = dialect.decimal == "," and dialect.delimiter != ","
        between = re.escape(dialect.delimiter)
        self._pointed = re.compile(rf"(?:^|{between}){POINTED}(?:{between}|$)", re.M)
        kinds = ["i8" if w.as_time else "f8" for w in wanted]
        self._dtype = np.dtype([(f"c{n}", kind) for n, kind in enumerate(kinds)])

    def read(
        self, lines: list[str], number: np.ndarray, problems: Problems
    ) -> tuple[Columns, np.ndarray]:
        """Return the columns (n,) of `lines`, and the numbers of the lines they are of (n,).

        Raises RecordError for numbers with thousands separators.
        """
        if lines and not self._dates and self._even(lines):
            try:
                return self._at_once(lines), number
            except ValueError:
                pass  # a cell that is no number: look at each
        return self._one_by_one(lines, number, problems)

    def _even(self, lines: list[str]) -> bool:
        """Return whether all lines have the cells that rows should have, as `_fits` would say.

        And whether, where the decimal sign is a comma, none may have points between thousands.
        """
        d = self._dialect
        text = "\n".join(lines)
        if d.delimiter == " " or d.separators < d.cells - 1 or '"' in text:
            return False
        if self._swap and self._pointed.search(text):
            return False
        end = d.delimiter * (d.separators - d.cells + 1)
        counts = {line.count(d.delimiter) for line in lines}
        return counts == {d.separators} and (not end or all(line.endswith(end) for line in lines))

    def _at_once(self, lines: list[str]) -> Columns:
        if self._swap:
            lines = "\n".join(lines).replace(",", ".").split("\n")
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a whole number written as 1.5e9: not at once
            try:
                table = np.loadtxt(
                    lines,
                    self._dtype,
                    delimiter=self._dialect.delimiter,
                    comments=None,
                    usecols=[w.index for w in self._wanted],
                    ndmin=1,
                )
            except Warning as warning:
                raise ValueError(str(warning)) from None
        if table.size != len(lines):
            raise ValueError("lines that belong together")
        return tuple(np.ascontiguousarray(table[name]) for name in self._dtype.names or ())

    def _one_by_one(
        self, lines: list[str], number: np.ndarray, problems: Problems
    ) -> tuple[Columns, np.ndarray]:
        d = self._dialect
        rows = [split_line(line, d.delimiter) for line in lines]
        fits = np.array([_fits(row, d.cells) for row in rows], bool)
        problems.add(f"other than {d.cells} cells in it{LEFT_OUT}", number[~fits])
        rows = [row for row, good in zip(rows, fits, strict=True) if good]
        return tuple(self._column(w, rows, number[fits]) for w in self._wanted), number[fits]

    def _column(self, wanted: WantedColumn, rows: list[list[str]], line: np.ndarray) -> np.ndarray:
        cells = [row[wanted.index] if wanted.index < len(row) else "" for row in rows]
        if wanted.index in self._dates:
            return dates_ns(cells, self._dialect.decimal, self._date_format)
        values = [number(cell, self._dialect.decimal) for cell in cells]
        self._refuse_grouped(cells, values, line)
        if wanted.as_time:
            comma = self._dialect.decimal == ","
            plain = [cell.replace(",", ".") for cell in cells] if comma else cells
            return np.array([_whole(cell) for cell in plain], np.int64)
        return np.array(values, float)  # None is nan

    def _refuse_grouped(
        self, cells: list[str], values: list[float | None], line: np.ndarray
    ) -> None:
        """Raise RecordError for a number in groups: missing, only the large values would be.

        With a decimal comma a point is no decimal sign: 1.012 would be a thousandth of itself.
        """
        for cell, value, at in zip(cells, values, line, strict=True):
            dotted = self._dialect.decimal == "," and "." in cell
            if (value is None or dotted) and GROUPED.fullmatch(cell):
                raise RecordError(
                    f"{self._path}: line {at}: '{cell}' has thousands separators, if it is a "
                    f"number with the decimal sign '{self._dialect.decimal}'; write numbers "
                    "without them"
                )


def _fits(row: list[str], cells: int) -> bool:
    return len(row) == cells or (len(row) > cells and len(without_blank_end(row)) <= cells)


def _whole(cell: str) -> int:
    try:
        value = int(cell) if cell.lstrip("+-").isdigit() else int(float(cell))
    except (ValueError, OverflowError):
        return int(MISSING_NS)
    return value if abs(value) < -int(MISSING_NS) else int(MISSING_NS)


def dates_ns(cells: list[str], decimal: str, date_format: str | None) -> np.ndarray:
    """Return dates as Unix ns (n,), MISSING_NS for others; UTC if they do not say.

    date_format: as for `strptime`; None: ISO form. A time of day counts from midnight.
    """
    if decimal == ",":
        cells = [cell.replace(",", ".") for cell in cells]
        date_format = date_format and date_format.replace(",", ".")
    if date_format is None and not any(map(_has_zone, cells)):
        try:
            return np.array(cells, "M8[ns]").astype(np.int64)
        except ValueError:
            pass  # some are no dates
    return np.array([_date_ns(cell, date_format) for cell in cells], np.int64)


def _has_zone(date: str) -> bool:
    """Return whether a date in ISO form says its zone, with which numpy does not take it."""
    return "Z" in date or "+" in date or date.count("-") > 2


def _date_ns(cell: str, date_format: str | None) -> int:
    try:
        date = date_of(cell, date_format) if date_format else datetime.fromisoformat(cell)
    except ValueError:
        return int(MISSING_NS)
    date = date if date.tzinfo else date.replace(tzinfo=UTC)
    zero = MIDNIGHT if date.year == MIDNIGHT.year else EPOCH
    seconds = (date.replace(microsecond=0) - zero).total_seconds()
    value = round(seconds) * 1_000_000_000 + date.microsecond * 1000
    return value if abs(value) < -int(MISSING_NS) else int(MISSING_NS)


class CsvSource(RowSource):
    """A CSV file; `wanted` names columns that it should have, by which its header is found.

    Raises RecordError for a file that is no table.
    """

    unit = "line"

    def __init__(self, path: Path, options: CsvMap, wanted: Sequence[str]) -> None:
        self.path = path
        self._dialect = d = detect(path, options, wanted)
        self._date_format = options.date_format
        self.times_of_day = is_time_of_day(options.date_format or "%Y")
        self._size = max(path.stat().st_size, 1)
        self.names = d.names
        self.notes = [
            f"{d.encoding}, delimiter {d.delimiter!r}, decimal {d.decimal!r}, "
            f"rows from line {d.first_line}"
        ]

    def holds_dates(self, index: int) -> bool:
        """Return whether a column holds dates; numbers may be some if `date_format` is given."""
        decimal = self._dialect.decimal
        cells = [row[index] for row in self._dialect.sample if index < len(row)]
        numbers = sum(number(cell, decimal) is not None for cell in cells)
        dates = dates_ns(cells, decimal, self._date_format) != MISSING_NS
        return int(dates.sum()) >= (numbers + 1 if self._date_format is None else max(numbers, 1))

    def holds_whole_numbers(self, index: int) -> bool:
        """Return whether a column holds whole numbers."""
        cells = [row[index] for row in self._dialect.sample if index < len(row)]
        return all(cell.lstrip("+-").isdecimal() for cell in cells if cell)

    def blocks(self, wanted: Sequence[WantedColumn], problems: Problems) -> Iterator[RawBlock]:
        """Yield all rows; those that have another number of cells are noted and left out."""
        dates = tuple(w.index for w in wanted if w.as_time and self.holds_dates(w.index))
        reader = CellReader(self.path, self._dialect, tuple(wanted), dates, self._date_format)
        count = 0
        for text, first_line, done in self._text():
            lines, numbers = _rows(text, first_line, self._dialect)
            columns, line = reader.read(lines, numbers, problems)
            if line.size:
                yield RawBlock(columns, count + 1 + np.searchsorted(numbers, line), line, done)
            count += numbers.size

    def _text(self) -> Iterator[tuple[list[str], int, float]]:
        """Yield lines, the number of the first of them, and the share of the file read so far."""
        d = self._dialect
        line, rest = 1, ""
        try:
            with (
                self.path.open("rb") as raw,
                io.TextIOWrapper(raw, d.encoding, errors="replace") as file,
            ):
                while text := file.read(BLOCK_CHARACTERS):
                    lines = (rest + text).split("\n")
                    rest = lines.pop()
                    if len(rest) > LINE_MAX:
                        raise RecordError(
                            f"{self.path}: line {line + len(lines)} is longer than "
                            f"{LINE_MAX} characters: not a table"
                        )
                    skip = max(0, min(d.first_line - line, len(lines)))
                    done = min(raw.tell() / self._size, 1.0)
                    yield lines[skip:], line + skip, done
                    line += len(lines)
                if rest and line >= d.first_line:
                    yield [rest], line, 1.0
        except (OSError, UnicodeError) as error:
            raise RecordError(f"{self.path}: cannot read line {line} and on: {error}") from error


def _rows(lines: list[str], first: int, dialect: Dialect) -> tuple[list[str], np.ndarray]:
    """Return the lines that are rows, and their numbers."""
    numbers = np.arange(first, first + len(lines))
    comment = dialect.comment
    if "" not in lines and not (comment and comment in "\n".join(lines)):
        return lines, numbers
    keep = np.array([is_row(line, comment) for line in lines], bool)
    return [line for line, kept in zip(lines, keep, strict=True) if kept], numbers[keep]
