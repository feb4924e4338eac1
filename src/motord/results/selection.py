"""Rows of a store for charts and comparisons: of each measurement the newest analysis."""

import re
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Literal

from motord.results.error import ResultsError
from motord.results.query import query
from motord.results.stored_result import COLUMNS, ResultRow

if TYPE_CHECKING:
    import pyarrow as pa

NEAR_NAMES = 5
"""Names that are proposed for one that there is not."""

Column = Literal["serial", "run", "version"]


def rows_of(table: "pa.Table", field: str | None, where: str = "") -> list[ResultRow]:
    """Return the rows of a field, or all, for which the SQL condition holds, in order of time.

    Raises ResultsError, which proposes near names, if there are none.
    """
    held = f"({where}\n)" if where else "true"
    if field is None:
        rows = _rows(table, held)
        if not rows:
            raise _none(where)
        return rows
    rows = _rows(table, f"field = ? AND {held}", field)
    if not rows:
        fields = query(table, f"SELECT DISTINCT field FROM results WHERE {held}")
        known = [name for (name,) in fields.rows]
        raise (
            ResultsError(f"no field {field!r}{_proposed(field, known)}") if known else _none(where)
        )
    experiments = sorted({row.experiment for row in rows})
    if len(experiments) > 1:
        raise ResultsError(
            f"{field} is a field of {', '.join(experiments)}: choose one with "
            f"--where \"experiment = '{experiments[0]}'\""
        )
    units = sorted({row.unit for row in rows})
    if len(units) > 1:
        raise ResultsError(
            f"{field} is in {' and in '.join(unit or 'no unit' for unit in units)}: choose with "
            f"--where \"unit = '{units[-1]}'\""
        )
    return rows


def _rows(table: "pa.Table", condition: str, *parameters: object) -> list[ResultRow]:
    """Return rows in order of time."""
    found = query(table, f"SELECT {', '.join(COLUMNS)} FROM results WHERE {condition}", parameters)
    return sorted((ResultRow(*row) for row in found.rows), key=_order)


def _none(where: str) -> ResultsError:
    return ResultsError(f"no results where {where}" if where else "the store is empty")


def newest(rows: Iterable[ResultRow]) -> list[ResultRow]:
    """Return of each measurement the rows of the newest version that analysed it.

    One of an unknown version, whose time is not that of its recordings, counts only where no other
    result has recordings of these names. Raises ResultsError where there are results by several
    choices of settings.
    """
    versions: dict[tuple[object, ...], set[str]] = {}
    rows = list(rows)
    analysed = {_recordings(row) for row in rows if row.version}
    rows = [row for row in rows if row.version or _recordings(row) not in analysed]
    for row in rows:
        versions.setdefault(_measurement(row), set()).add(row.version)
    last = {key: max(found, key=_version_key) for key, found in versions.items()}
    kept = [row for row in rows if row.version == last[_measurement(row)]]
    settings: dict[tuple[object, ...], str] = {}
    for row in kept:
        if settings.setdefault(_measurement(row), row.settings) != row.settings:
            first = settings[_measurement(row)]
            raise ResultsError(
                f"{row.run} was analysed with settings {first} and {row.settings}: choose with "
                "--where \"settings LIKE '%...%'\""
            )
    return kept


def either(
    rows: Sequence[ResultRow], a: str, b: str
) -> tuple[Column, list[ResultRow], list[ResultRow]]:
    """Return what a and b are, serial numbers, recordings or versions, and the rows of each.

    Raises ResultsError, which proposes near names.
    """
    columns: tuple[Column, ...] = ("serial", "run", "version")
    for column in columns:
        of_a, of_b = ([row for row in rows if name in _names(row, column)] for name in (a, b))
        if of_a and of_b:
            if column == "run":
                _require_one_motor(a, of_a)
                _require_one_motor(b, of_b)
            return column, of_a, of_b
    known = {name for row in rows for column in columns for name in _names(row, column)}
    unknown = next((name for name in (a, b) if name not in known), None)
    known = {name for name in known if ", " not in name}
    if unknown is None:
        raise ResultsError(f"{a} and {b} are not both serial numbers, recordings or versions")
    raise ResultsError(
        f"no serial number, recording or version {unknown!r}{_proposed(unknown, known)}"
    )


def _require_one_motor(name: str, rows: Sequence[ResultRow]) -> None:
    motors = sorted({row.serial or row.motor for row in rows})
    if len(motors) > 1:
        raise ResultsError(
            f"{name} is a recording of {', '.join(motors)}: choose with "
            f"--where \"serial = '{motors[0]}'\""
        )


def _names(row: ResultRow, column: Column) -> tuple[str, ...]:
    """Return the names by which a row is chosen: of several recordings all and each."""
    value = getattr(row, column)
    return tuple(dict.fromkeys((value, *value.split(", ")))) if column == "run" else (value,)


def _recordings(row: ResultRow) -> tuple[object, ...]:
    return row.experiment, row.motor, row.serial, row.run


def _measurement(row: ResultRow) -> tuple[object, ...]:
    return *_recordings(row), row.bench, row.time


def _order(row: ResultRow) -> tuple[object, ...]:
    return row.time, row.run, row.version


def _version_key(version: str) -> tuple[tuple[int, int, str], ...]:
    """Return what versions are ordered by: numbers as numbers, a release after its candidates."""
    parts = re.findall(r"\d+|[a-z]+", version.partition("+")[0].lower())
    order = [
        (2, int(one), "") if one.isdecimal() else (int(one == "post"), 0, one) for one in parts
    ]
    return (*order, (1, 0, "")) if version else ()


def _proposed(name: str, known: Iterable[str]) -> str:
    """Return names that may be meant, as the end of a sentence."""
    names = sorted(filter(None, known))
    within = [one for one in names if name and name.lower() in one.lower()]
    near = list(dict.fromkeys((*within, *get_close_matches(name, names, NEAR_NAMES, 0.4))))
    return f"; near: {', '.join((near or names)[:NEAR_NAMES])}"
