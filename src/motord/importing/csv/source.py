"""CSV as a source of rows, a few thousand lines at a time."""

import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from motord.importing.csv.cells import CellReader, dates_ns
from motord.importing.csv.dialect import Dialect, detect, is_row, number
from motord.importing.mapping import CsvMap
from motord.importing.problems import Problems
from motord.importing.source import MISSING_NS, RawBlock, RowSource, WantedColumn
from motord.recording.errors import RecordError

BLOCK_CHARACTERS = 1 << 21
"""Text that is read at once."""

LINE_MAX = 1 << 20
"""Characters of the longest line of a table."""


class CsvSource(RowSource):
    """A CSV file; `wanted` names columns that it should have, by which its header is found.

    Raises RecordError for a file that is no table.
    """

    unit = "line"

    def __init__(self, path: Path, options: CsvMap, wanted: Sequence[str]) -> None:
        self.path = path
        self._dialect = d = detect(path, options, wanted)
        self._date_format = options.date_format
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
        for lines, first_line, done in self._text():
            block = reader.read(*_rows(lines, first_line, self._dialect), problems)
            if block[1].size:
                yield RawBlock(*block, done)

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
