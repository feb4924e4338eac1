"""How a CSV file is written: encoding, delimiter, decimal sign, where its rows begin."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import product
from pathlib import Path

from motord.importing.mapping import CsvMap
from motord.importing.source import readable
from motord.recording.errors import RecordError

SAMPLE_BYTES = 1 << 18
"""Bytes at the beginning of a file that are looked at."""

HEADER_LINES = 200
"""Lines among which the names of the columns are looked for."""

UNIT_LINES = 5
"""Lines of units and the like that there may be between the names and the first row."""

DELIMITERS = (",", ";", "\t", "|", " ")
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")


@dataclass(frozen=True)
class Dialect:
    """How the file is written.

    delimiter: " " is any number of blanks; names: of the columns, "" for one without; cells: in a
    row; separators: delimiters in a row, more than cells - 1 if rows end with one; first_line: of
    the rows, from 1 on; sample: cells of the first rows.
    """

    encoding: str
    delimiter: str
    decimal: str
    comment: str
    names: tuple[str, ...]
    cells: int
    separators: int
    first_line: int
    sample: tuple[tuple[str, ...], ...]


def detect(path: Path, options: CsvMap, wanted: Sequence[str]) -> Dialect:
    """Find out how `path` is written; `wanted` names columns that it should have.

    Raises RecordError for a file that is no table of text.
    """
    raw, whole = _beginning(path)
    encoding = options.encoding or _encoding(raw)
    lines = _lines(path, raw, encoding, whole)
    header, delimiter = _header(lines, options, wanted)
    names = tuple(split_line(lines[header - 1], delimiter)) if header else ()
    numbers = [
        n
        for n in range(max(header, options.skip_lines) + 1, len(lines) + 1)
        if is_row(lines[n - 1], options.comment)
    ]
    rows = [(n, split_line(lines[n - 1], delimiter)) for n in numbers[: HEADER_LINES + UNIT_LINES]]
    decimal = options.decimal or _decimal([cells for _, cells in rows])
    usual = 0 if header else _usual_cells(lines, delimiter)
    while rows and not _begins(rows[0][1], decimal, usual):
        if len(rows) == 1 or numbers.index(rows[0][0]) >= (UNIT_LINES if header else HEADER_LINES):
            raise RecordError(f"{path}: line {rows[0][0]}: a row of numbers should begin here")
        rows.pop(0)
    if not rows:
        raise RecordError(f"{path}: there are no rows of numbers in it")
    first_line, first = rows[0]
    return Dialect(
        encoding=encoding,
        delimiter=delimiter,
        decimal=decimal,
        comment=options.comment,
        names=names + ("",) * (len(first) - len(names)),
        cells=_cells(len(without_blank_end(names)), [cells for _, cells in rows]),
        separators=len(first) - 1,
        first_line=first_line,
        sample=tuple(tuple(cells) for _, cells in rows),
    )


def _begins(cells: Sequence[str], decimal: str, usual: int) -> bool:
    """Return whether rows begin with these cells: a number or date, `usual` cells (0: any)."""
    return usual in (0, len(cells)) and any(holds_value(cell, decimal) for cell in cells)


def _cells(named: int, rows: Sequence[Sequence[str]]) -> int:
    """Return how many cells rows have: as many as have names, unless no row is like that."""
    if any(len(row) >= named >= len(without_blank_end(row)) for row in rows) and named:
        return named
    return Counter(map(len, rows)).most_common(1)[0][0]


def split_line(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, without quotes and blanks around them."""
    if delimiter == " ":
        return line.replace('"', "").split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return [line]


def is_row(line: str, comment: str) -> bool:
    """Return whether a line is neither blank nor a comment."""
    return bool(line.strip()) and not (comment and line.lstrip().startswith(comment))


def without_blank_end(cells: Sequence[str]) -> Sequence[str]:
    """Return cells without the empty ones at their end."""
    end = len(cells)
    while end and not cells[end - 1]:
        end -= 1
    return cells[:end]


def number(cell: str, decimal: str) -> float | None:
    """Return the number that a cell holds, None for another text."""
    try:
        return float(cell.replace(",", ".") if decimal == "," else cell)
    except ValueError:
        return None


def is_date(cell: str) -> bool:
    """Return whether a cell holds a date in ISO form, with or without time."""
    try:
        datetime.fromisoformat(cell.replace(",", "."))
    except ValueError:
        return False
    return "-" in cell


def holds_value(cell: str, decimal: str) -> bool:
    """Return whether a cell holds a number or a date."""
    return number(cell, decimal) is not None or is_date(cell)


def _beginning(path: Path) -> tuple[bytes, bool]:
    """Return the beginning of a file, and whether that is all of it."""
    with readable(path), path.open("rb") as file:
        raw = file.read(SAMPLE_BYTES)
        return raw, not file.read(1)


def _encoding(raw: bytes) -> str:
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if raw.startswith(b"\xef\xbb\xbf"):
        return "utf-8-sig"
    try:
        raw[: raw.rfind(b"\n") + 1 or None].decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


FROM_ITS_PROGRAM = "write it as one of these where it is from"
OTHER_FORMATS = {
    b"PAR1": "pandas.read_parquet(FILE).to_csv(CSV, index=False) makes CSV of Parquet",
    b"MATLAB 5.0 MAT-file": "scipy.io.loadmat(FILE) reads it, pandas.DataFrame.to_csv writes CSV",
    b"\x89HDF": "h5py reads it, pandas.DataFrame.to_csv writes CSV",
    b"PK\3\4": "is it a spreadsheet? Save it as CSV",
    b"\x89MCAP": "a recording in MCAP, which `motord record info` and `analyse` take as it is",
}
"""First bytes of what is often meant to be imported, and what to do."""


def _lines(path: Path, raw: bytes, encoding: str, whole: bool) -> list[str]:
    try:
        text = raw.decode(encoding, errors="replace")
    except (LookupError, UnicodeError) as error:
        raise RecordError(f"{path}: cannot be read as {encoding}: {error}") from error
    known = (way for begins, way in OTHER_FORMATS.items() if raw.startswith(begins))
    if way := next(known, FROM_ITS_PROGRAM if "\0" in text else ""):
        raise RecordError(f"{path}: not a table of text, nor a TDMS or MDF 4 file; {way}")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if not whole:
        lines.pop()
    if not any(line.strip() for line in lines):
        raise RecordError(f"{path}: has no lines of text in its first {len(raw)} bytes")
    return lines


def _header(lines: Sequence[str], options: CsvMap, wanted: Sequence[str]) -> tuple[int, str]:
    """Return the line of the columns' names, 0 if there is none, and the delimiter."""
    delimiters = (options.delimiter,) if options.delimiter else DELIMITERS
    if options.header_line == 0:
        return 0, _delimiter_of_rows(lines, delimiters)
    if options.header_line:
        candidates = [min(options.header_line, len(lines))]
    else:
        candidates = [
            n
            for n in range(options.skip_lines + 1, min(len(lines), HEADER_LINES) + 1)
            if lines[n - 1].strip()
        ]
    named = {name.strip() for name in wanted}
    found = {
        (n, delimiter): len(named.intersection(split_line(lines[n - 1], delimiter)))
        for n, delimiter in product(candidates, delimiters)
    }
    if any(found.values()):
        return max(found, key=lambda place: found[place])
    delimiter = _delimiter_of_rows(lines, delimiters)
    return _line_above_rows(lines, candidates, delimiter), delimiter


def _delimiter_of_rows(lines: Sequence[str], delimiters: Sequence[str]) -> str:
    """Return the delimiter that makes most numbers of the last lines that are looked at."""
    last = [line for line in lines if line.strip()][-50:]

    def values(delimiter: str) -> int:
        decimal = _decimal([split_line(line, delimiter) for line in last])
        return sum(holds_value(c, decimal) for line in last for c in split_line(line, delimiter))

    return max(delimiters, key=values)


def _line_above_rows(lines: Sequence[str], candidates: Sequence[int], delimiter: str) -> int:
    """Return the last line above the first row that has as many cells but no number, or 0."""
    above, usual = 0, _usual_cells(lines, delimiter)
    for n in candidates:
        cells = split_line(lines[n - 1], delimiter)
        if len(cells) != usual:
            continue
        decimal = _decimal([cells])
        if any(holds_value(cell, decimal) for cell in cells):
            return above
        above = n
    return above


def _usual_cells(lines: Sequence[str], delimiter: str) -> int:
    """Return how many cells most of the last lines have that are looked at."""
    last = [line for line in lines if line.strip()][-50:]
    return Counter(len(split_line(line, delimiter)) for line in last).most_common(1)[0][0]


def _decimal(rows: Sequence[Sequence[str]]) -> str:
    """Return the decimal sign: a comma if there are numbers with one and none with a point."""
    cells = [cell for row in rows for cell in row]
    commas = sum(DECIMAL_COMMA.fullmatch(cell) is not None for cell in cells)
    points = sum("." in cell and number(cell, ".") is not None for cell in cells)
    return "," if commas > points else "."
