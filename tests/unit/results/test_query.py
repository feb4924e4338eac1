"""SQL sees the results and nothing else, and changes nothing."""

import math
import subprocess
import sys
from datetime import datetime

import pytest

from motord.results.error import ResultsError
from motord.results.query import query
from tests.support.patience import PATIENCE_S
from tests.unit.results.made_up import fill


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("results") / "s"


@pytest.fixture(scope="module")
def table(folder):
    return fill(folder, [0.8, 0.9, 0.7]).read().table


@pytest.mark.parametrize(
    ("sql", "columns", "rows"),
    [
        ("SELECT count(*) AS n FROM results", ("n",), [(3,)]),
        ("FROM results SELECT max(value) AS m", ("m",), [(0.9,)]),
        (
            "SELECT time FROM results WHERE time >= '2026-03-02' ORDER BY time LIMIT 1;",
            ("time",),
            [(datetime(2026, 3, 2, 8),)],
        ),
        ("SELECT run FROM results WHERE value < 0.75", ("run",), [("run-002.mcap",)]),
        ("WITH t AS (SELECT 1 AS a) SELECT a FROM t", ("a",), [(1,)]),
        ("SELECT 1 AS a WHERE false", ("a",), []),
        (
            "PIVOT results ON run USING first(value) GROUP BY field",
            ("field", "run-000.mcap", "run-001.mcap", "run-002.mcap"),
            [("alpha.a", 0.8, 0.9, 0.7)],
        ),
    ],
)
def test_questions(table, sql, columns, rows):
    answer = query(table, sql)
    assert (answer.columns, answer.rows) == (columns, rows)


def test_now_is_utc_as_the_times_of_results_are(table):
    """In another zone `time > now() - INTERVAL 1 HOUR` would be hours off."""
    assert query(table, "SELECT current_setting('TimeZone')").rows == [("UTC",)]


def test_values_are_those_that_were_stored_bit_for_bit(tmp_path):
    values = [0.1 + 0.2, math.pi, 5e-324, 1.7976931348623157e308, -0.0]
    table = fill(tmp_path / "s", values).read().table
    rows = query(table, "SELECT value FROM results ORDER BY run").rows
    assert [value.hex() for (value,) in rows] == [value.hex() for value in values]


@pytest.mark.parametrize(
    ("sql", "why"),
    [
        ("SELEC 1", 'syntax error at or near "SELEC"'),
        ("SELECT nofield FROM results", "Candidate bindings: "),
        ("SELECT * FROM nothing", "nothing does not exist"),
        ("SELECT 'a'::INT", "convert"),
        ("SELECT ?", "parameter"),
        ("SELECT 'open", "unterminated"),
        ("", "give one SELECT"),
        ("-- nothing", "give one SELECT"),
        ("SELECT 1; SELECT 2", "give one SELECT"),
        ("\udcff", "surrogates"),
        ("SELECT now() AS t", "t has a time zone: add ::TIMESTAMP"),
        ("SELECT [now()] AS t", "t has a time zone: add ::TIMESTAMP"),
    ],
)
def test_an_error_is_one_line(table, sql, why):
    with pytest.raises(ResultsError, match=r"^SQL: ") as caught:
        query(table, sql)
    assert why in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "LINE" not in str(caught.value)


CHANGES = [
    "INSERT INTO results SELECT * FROM results",
    "DELETE FROM results",
    "UPDATE results SET value = 0",
    "DROP VIEW results",
    "CREATE TABLE kept AS SELECT 1",
    "CREATE OR REPLACE VIEW results AS SELECT 1",
    "SET enable_external_access = true",
    "SET lock_configuration = false",
    "RESET enable_external_access",
    "PRAGMA database_list",
    "CALL pragma_version()",
    "CHECKPOINT",
    "PREPARE x AS SELECT 1",
]


@pytest.mark.parametrize("sql", CHANGES)
def test_nothing_is_changed(table, sql):
    with pytest.raises(ResultsError, match=r"^SQL: "):
        query(table, sql)


REACHING_OUT = [
    "SELECT * FROM read_csv('{csv}')",
    "SELECT * FROM read_csv_auto('{csv}')",
    "SELECT * FROM '{csv}'",
    "SELECT * FROM '{parquet}'",
    "SELECT * FROM read_parquet('{parquet}')",
    "SELECT * FROM parquet_scan('{parquet}')",
    "SELECT * FROM parquet_metadata('{parquet}')",
    "SELECT * FROM read_json('{csv}')",
    "SELECT * FROM read_text('{csv}')",
    "SELECT * FROM read_blob('{csv}')",
    "SELECT * FROM sniff_csv('{csv}')",
    "SELECT * FROM glob('{folder}/*')",
    "SELECT * FROM query_table('{csv}')",
    "SELECT * FROM query('SELECT * FROM read_text(''{csv}'')')",
    "SELECT (SELECT content FROM read_text('{csv}')) FROM results",
    "PIVOT (SELECT * FROM read_csv('{csv}')) ON a USING first(b)",
    "EXPLAIN ANALYZE SELECT * FROM read_csv('{csv}')",
    "EXPLAIN ANALYZE COPY results TO '{folder}/out.csv'",
    "COPY results TO '{folder}/out.csv'",
    "COPY (SELECT 1) TO '{folder}/out.parquet' (FORMAT parquet)",
    "COPY results FROM '{csv}'",
    "EXPORT DATABASE '{folder}/out'",
    "IMPORT DATABASE '{folder}/out'",
    "ATTACH '{folder}/out.db'",
    "ATTACH '{folder}/out.db' AS other (READ_ONLY)",
    "INSTALL httpfs",
    "INSTALL spatial FROM community",
    "INSTALL '{folder}/any.duckdb_extension'",
    "LOAD httpfs",
    "LOAD '{folder}/any.duckdb_extension'",
    "SELECT * FROM read_csv('https://example.org/a.csv')",
    "SELECT * FROM 's3://bucket/store/*.parquet'",
    "SELECT * FROM read_parquet('memory://bucket/a.parquet')",
    "COPY results TO 's3://bucket/store/out.parquet'",
    "SELECT * FROM table_of_this_program",
    "SELECT * FROM naive",
    "SELECT * FROM rows",
    "SELECT getenv('HOME')",
    "SELECT * FROM duckdb_secrets()",
]


@pytest.mark.parametrize("sql", REACHING_OUT)
def test_no_file_is_read_or_written(table, folder, tmp_path, sql):
    table_of_this_program = table
    other = tmp_path / "other"
    other.mkdir()
    csv = other / "a.csv"
    csv.write_text("a,b\nsecret,2\n")
    [parquet, *_] = folder.iterdir()
    before = sorted(path.name for path in other.iterdir())
    with pytest.raises(ResultsError, match=r"^SQL: ") as caught:
        query(table_of_this_program, sql.format(csv=csv, parquet=parquet, folder=other))
    assert "secret" not in str(caught.value).replace("duckdb_secrets", "").replace(
        "stored_secrets", ""
    )
    assert sorted(path.name for path in other.iterdir()) == before


def test_settings_hold_by_themselves_not_only_by_the_kind_of_statement(
    table, tmp_path, monkeypatch
):
    """The engine refuses files and settings, too, where a statement should slip through."""
    monkeypatch.setattr(
        "motord.results.query.KINDS",
        ("SELECT", "COPY", "ATTACH", "LOAD", "SET", "VARIABLE_SET", "EXPORT", "PRAGMA", "INSTALL"),
    )
    reaching = [sql for sql in REACHING_OUT if not sql.startswith(("EXPLAIN", "PIVOT"))]
    for sql in [*reaching, *(one for one in CHANGES if one.startswith(("SET", "RESET")))]:
        with pytest.raises(ResultsError, match=r"^SQL: "):
            query(table, sql.format(csv=tmp_path / "a.csv", parquet="x.parquet", folder=tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_a_command_that_asks_prints_the_answer_and_nothing_else(folder, table):
    del table  # the folder is filled with it
    sql = "SELECT count(*) AS n FROM results"
    done = subprocess.run(
        [sys.executable, "-m", "motord", "results", "query", sql, "--csv", "--store", folder],
        check=False, capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip
    assert (done.returncode, done.stdout.split(), done.stderr) == (0, ["n", "3"], "")
