"""SQL over the rows of a store, as the view `results`; nothing else can be read or written."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from motord.results.error import ResultsError, duckdb

if TYPE_CHECKING:
    import pyarrow as pa

VIEW = "results"

OPTIONS = {
    "autoinstall_known_extensions": False,
    "autoload_known_extensions": False,
    "python_enable_replacements": False,
    "temp_directory": "",
}
"""No extensions, no variables of this program as tables, no files to swap to."""

KINDS = ("SELECT", "MULTI")
"""Statements that change nothing; MULTI is PIVOT, which finds out its columns first."""


@dataclass(frozen=True)
class Answer:
    """Names of the columns, and rows of values as Python has them."""

    columns: tuple[str, ...]
    rows: list[tuple[Any, ...]]


def query(table: "pa.Table", sql: str, parameters: Sequence[object] = ()) -> Answer:
    """Return what one statement gives of the rows in the view `results`. Raises ResultsError.

    `time` is UTC, a timestamp without a zone.
    """
    import pyarrow as pa

    engine = duckdb()
    naive = table.column("time").cast(pa.timestamp("us"))
    rows = table.set_column(table.schema.get_field_index("time"), "time", naive)
    try:
        sql.encode()
        with engine.connect(":memory:", config=OPTIONS) as connection:
            connection.register(VIEW, rows)
            connection.execute("SET TimeZone = 'UTC'")  # of now(), which is compared with `time`
            connection.execute("SET enable_external_access = false")
            connection.execute("SET lock_configuration = true")
            statements = connection.extract_statements(sql)
            if [one.type.name for one in statements] not in [[kind] for kind in KINDS]:
                raise ResultsError("SQL: give one SELECT: the store is only read")
            answer = connection.execute(statements[0], parameters)
            description = answer.description or ()
            for name, kind, *_ in description:
                if "WITH TIME ZONE" in str(kind):  # needs pytz, which duckdb does not bring along
                    raise ResultsError(f"SQL: {name} has a time zone: add ::TIMESTAMP, it is UTC")
            columns = tuple(column[0] for column in description)
            return Answer(columns, answer.fetchall())
    except (engine.Error, UnicodeError) as error:
        reason = str(error).split("\n\n")[0]  # without the picture of where in the statement it is
        raise ResultsError(f"SQL: {' '.join(reason.split())}") from None
