"""Lines of CSV as columns of numbers: all at once where they are clean, else cell by cell."""

import re
import warnings
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from motord.importing.csv.dialect import Dialect, number, split_line, without_blank_end
from motord.importing.problems import LEFT_OUT, Problems
from motord.importing.source import MISSING_NS, WantedColumn
from motord.recording.errors import RecordError

Columns = tuple[np.ndarray, ...]

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
MIDNIGHT = datetime(1900, 1, 1, tzinfo=UTC)
"""What `strptime` adds to a time of day."""

GROUPED = re.compile(r"[+-]?\d{1,3}([,.' \u00a0\u202f])\d{3}(?:\1\d{3})*(?:[.,]\d*)?")
"""Numbers with thousands separators, among others."""
POINTED = r"\s*[+-]?\d{1,3}(?:\.\d{3})+\s*"
"""Those of points alone."""


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
    if date_format is None and not any("Z" in cell or "+" in cell for cell in cells):
        try:
            return np.array(cells, "M8[ns]").astype(np.int64)
        except ValueError:
            pass  # some are no dates
    return np.array([_date_ns(cell, date_format) for cell in cells], np.int64)


def _date_ns(cell: str, date_format: str | None) -> int:
    try:
        date = datetime.strptime(cell, date_format) if date_format else datetime.fromisoformat(cell)
    except ValueError:
        return int(MISSING_NS)
    date = date if date.tzinfo else date.replace(tzinfo=UTC)
    zero = MIDNIGHT if date.year == MIDNIGHT.year else EPOCH
    seconds = (date.replace(microsecond=0) - zero).total_seconds()
    value = round(seconds) * 1_000_000_000 + date.microsecond * 1000
    return value if abs(value) < -int(MISSING_NS) else int(MISSING_NS)
