"""What is stored is there whole, once, and read back as it was; what cannot be read is named."""

import os
import sys
from contextlib import suppress
from datetime import timedelta
from pathlib import Path

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import parquet

from motord.results.error import ResultsError
from motord.results.figures import ResultFigure
from motord.results.parquet_file import (
    RECORDINGS_KEY,
    SCHEMA_KEY,
    NotAResultError,
    decode_result,
    encode_result,
    table_schema,
)
from motord.results.query import query
from motord.results.store import ResultsStore
from motord.results.stored_result import COLUMNS, StoredResult
from tests.unit.results.made_up import BEGIN, figure, fill, result

RELEASED = Path(__file__).parents[2] / "data" / "results-1.parquet"

NAMES = st.text(max_size=12)
FINITE = st.floats(allow_nan=False, allow_infinity=False)
FIGURES = st.builds(
    ResultFigure, NAMES, NAMES, FINITE, st.none() | FINITE, st.none() | FINITE, st.none() | FINITE
)
RESULTS = st.builds(
    StoredResult,
    experiment=NAMES,
    motor=NAMES,
    serial=NAMES,
    bench=NAMES,
    run=NAMES,
    time=st.integers(0, 10**9).map(lambda seconds: BEGIN + timedelta(seconds=seconds)),
    version=NAMES,
    settings=st.dictionaries(NAMES, NAMES | st.none() | FINITE, max_size=3),
    recordings=st.lists(st.tuples(NAMES, NAMES), max_size=3),
    figures=st.lists(FIGURES, min_size=1, max_size=4),
)


def test_the_columns_are_an_interface():
    assert COLUMNS == (
        "experiment", "motor", "serial", "bench", "run", "time", "version", "settings",
        "field", "unit", "value", "stderr", "low", "high",
    )  # fmt: skip


@given(RESULTS)
def test_a_result_reads_back_as_it_was(result):
    table = decode_result(encode_result(result))
    assert table.schema.equals(table_schema())
    assert table.schema.field("time").type == pa.timestamp("us", tz="UTC")
    assert table.to_pylist() == [vars(row) for row in result.rows()]
    assert encode_result(result) == encode_result(result)


@given(RESULTS)
def test_a_file_name_is_one_of_any_file_system(result):
    assert result.file_name.isascii()
    assert result.file_name.isprintable()
    assert not set(result.file_name) & set('/\\:*?"<>| ')
    assert not result.file_name.startswith(".")
    assert len(result.file_name) < 200


@pytest.mark.parametrize(
    "serial", ["../../etc/passwd", "..", "a/b", "x" * 500, "Ø 7 'drop'", "\n", ".parquet", "-"]
)
def test_an_odd_serial_stays_in_the_folder_and_reads_back(tmp_path, serial):
    added = fill(tmp_path / "s", 0.8, serial=serial).add(result(7, serial=serial))
    assert added.path.parent == tmp_path / "s"
    assert added.new
    assert set(ResultsStore(tmp_path / "s").read().table["serial"].to_pylist()) == {serial}


@pytest.mark.parametrize(
    "change",
    [
        {"version": "1.1"},
        {"settings": {"method": "residual"}},
        {"recordings": [("run-000.mcap", "f" * 64)]},
        {"recordings": [("run-000.mcap", f"{0:064x}"), ("more.mcap", "f" * 64)]},
        {"experiment": "verify"},
        {"serial": "A-2"},
    ],
)
def test_another_analysis_is_another_file(tmp_path, change):
    store = fill(tmp_path / "s", 0.8)
    assert store.add(result(0, **change)).new
    assert store.read().table.num_rows == 2


@pytest.mark.parametrize(
    "again",
    [
        {},
        {"time": BEGIN + timedelta(hours=1)},
        {"figures": [figure(0.8 + 1e-15)]},  # another processor rounds otherwise
        {"recordings": [("copy.mcap", f"{0:064x}")], "run": "copy.mcap"},
    ],
)
def test_the_same_analysis_is_stored_once(tmp_path, again):
    store = fill(tmp_path / "s", 0.8)
    [before] = (tmp_path / "s").iterdir()
    content = before.read_bytes()
    added = store.add(result(0, **again))
    assert not added.new
    assert added.path == before
    assert "duplicate result" in added.to_text()
    assert [path.read_bytes() for path in (tmp_path / "s").iterdir()] == [content]


def test_recordings_are_the_same_in_any_order():
    two = [("a.mcap", "a" * 64), ("b.mcap", "b" * 64)]
    assert result(recordings=two).file_name == result(recordings=two[::-1]).file_name
    assert result(recordings=two).file_name != result(recordings=two[:1]).file_name


def test_who_adds_many_lists_the_names_once(tmp_path, monkeypatch):
    store = fill(tmp_path / "s", (0.8, 0.9))
    listed = []
    names = store.folder.names
    monkeypatch.setattr(store.folder, "names", lambda: listed.append(1) or names())
    store.list_once()
    assert not store.add(result(1, (0.9,))).new  # that was there
    assert [store.add(result(number)).new for number in (2, 3, 3, 2)] == [True, True, False, False]
    assert len(listed) == 1
    assert store.read().table.num_rows == 4


def test_of_an_unknown_version_the_same_figures_are_a_duplicate(tmp_path):
    store = fill(tmp_path / "s", 0.8)
    added = result(0, version="", settings={"added": "sha256:1"}, recordings=())
    assert not store.add(added).new
    other = result(0, (0.9,), version="", settings={"added": "sha256:2"}, recordings=())
    assert store.add(other).new


def test_a_damaged_file_is_stored_again(tmp_path):
    store = fill(tmp_path / "s", 0.8)
    [path] = (tmp_path / "s").iterdir()
    path.write_bytes(path.read_bytes()[:100])
    assert store.add(result(0)).new
    assert store.read().unreadable == ()
    assert store.read().table.num_rows == 1


def test_metadata_have_schema_and_recordings(tmp_path):
    fill(tmp_path / "s", 0.8)
    [path] = (tmp_path / "s").iterdir()
    metadata = parquet.read_schema(path).metadata
    assert metadata[SCHEMA_KEY] == b"1"
    assert metadata[RECORDINGS_KEY] == f'[["run-000.mcap", "{0:064x}"]]'.encode()


def test_files_of_released_schemas_stay_readable():
    rows = decode_result(RELEASED.read_bytes()).to_pylist()
    assert rows == [vars(row) for row in result().rows()]


def test_more_columns_than_the_table_has_are_passed_over(tmp_path):
    store = fill(tmp_path / "s", 0.8)
    [path] = (tmp_path / "s").iterdir()
    table = parquet.read_table(path)
    parquet.write_table(table.append_column("more", pa.array([1])), path)
    assert store.read().unreadable == ()
    table = store.read().table
    assert table.column_names == [*COLUMNS, "plan"]
    assert table.select(COLUMNS).schema.equals(table_schema())


def foreign(path):
    parquet.write_table(pa.table({"a": [1]}), path)


def newer(path):
    schema = pa.schema([pa.field("a", pa.int64())], metadata={SCHEMA_KEY: b"2"})
    parquet.write_table(pa.table({"a": [1]}, schema=schema), path)


def of_other_columns(path):
    schema = pa.schema([pa.field("a", pa.int64())], metadata={SCHEMA_KEY: b"1"})
    parquet.write_table(pa.table({"a": [1]}, schema=schema), path)


def of_other_types(path):
    table = decode_result(encode_result(result()))
    words = table.set_column(10, "value", pa.array(["much"]))
    parquet.write_table(words.replace_schema_metadata({SCHEMA_KEY: b"1"}), path)


def cut(path):
    path.write_bytes(encode_result(result())[:-20])


def bytes_changed(path):
    data = bytearray(encode_result(result()))
    data[4:200] = bytes(196)
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (Path.touch, "no Parquet file"),
        (lambda path: path.write_text("value\n1\n"), "no Parquet file"),
        (Path.mkdir, "Is a directory"),
        (foreign, "motord did not write"),
        (newer, "of schema 2, this motord reads up to 1: update motord"),
        (of_other_columns, "damaged, of schema 1"),
        (of_other_types, "damaged, of schema 1"),
        (cut, "no Parquet file"),
        (bytes_changed, "damaged, of schema 1"),
    ],
)
def test_what_cannot_be_read_is_named_and_the_rest_is_read(tmp_path, make, why):
    store = fill(tmp_path / "s", [0.8, 0.9])
    bad = tmp_path / "s" / "bad.parquet"
    make(bad)
    contents = store.read()
    [line] = contents.unreadable
    assert line.startswith(f"{bad}: ")
    assert why in line
    assert "\n" not in line
    assert contents.table["value"].to_pylist() == [0.8, 0.9]


@given(st.binary(max_size=200), st.integers(0, 3000), st.booleans())
def test_no_bytes_are_read_as_anything_but_a_result_or_a_reason(noise, place, inside):
    data = encode_result(result())
    if inside:
        data = data[:place] + noise + data[place + len(noise) :]
    else:
        data = noise
    with suppress(NotAResultError):
        assert decode_result(data).schema.equals(table_schema())


def test_unfinished_and_other_files_are_none_of_the_store(tmp_path):
    store = fill(tmp_path / "s", 0.8)
    (tmp_path / "s" / ".x.parquet.12.tmp").write_bytes(b"half")
    (tmp_path / "s" / ".hidden.parquet").write_bytes(b"half")
    (tmp_path / "s" / "notes.txt").write_text("notes")
    contents = store.read()
    assert (contents.table.num_rows, contents.unreadable) == (1, ())


@pytest.mark.parametrize("broken", ["fsync", "replace"])
def test_what_cannot_be_written_leaves_nothing(tmp_path, monkeypatch, broken):
    store = fill(tmp_path / "s", 0.8)
    before = sorted((tmp_path / "s").iterdir())

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(*((os, "fsync", full) if broken == "fsync" else (Path, "replace", full)))
    with pytest.raises(ResultsError, match=r"/s: cannot store the result: No space left on device"):
        store.add(result(1))
    assert sorted((tmp_path / "s").iterdir()) == before


def test_a_store_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ResultsError, match="none: there is no results store"):
        ResultsStore(tmp_path / "none").read()
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(ResultsError, match="cannot read the results store: Not a directory"):
            ResultsStore(folder).read()
        with pytest.raises(ResultsError, match="cannot store results there"):
            ResultsStore(folder).make()
    with pytest.raises(ResultsError, match="cannot store results there: No such file"):
        ResultsStore(tmp_path / "none" / "below").make()


def test_a_result_without_figures_is_none(tmp_path):
    with pytest.raises(ResultsError, match="no figures"):
        fill(tmp_path / "s", []).add(result(figures=[]))


@pytest.mark.parametrize("package", ["pyarrow", "duckdb"])
def test_a_missing_package_is_named_with_what_to_do(tmp_path, monkeypatch, package):
    store = fill(tmp_path / "s", 0.8)
    table = store.read().table
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ResultsError, match=rf"package {package}: pip install 'motord\[results\]'"):
        store.read() if package == "pyarrow" else query(table, "SELECT 1")


def test_settings_of_the_plan_are_columns_that_older_results_have_not(tmp_path):
    store = fill(tmp_path / "s", 0.8)
    (tmp_path / "s" / "older.parquet").write_bytes(RELEASED.read_bytes())
    plans = (
        {"plan": "calibrate", "setting_turns": 12.0, "setting_compensate": "off"},
        {"plan": "verify", "setting_turns": 5.0, "setting_compensate": True},
    )
    for number, plan in enumerate(plans, 1):
        store.add(result(number, plan=plan))
    table = store.read().table
    assert table.num_rows > 3
    asked = "SELECT plan, setting_turns, setting_compensate FROM results WHERE run = ?"
    found = [query(table, asked, [f"run-{number:03d}.mcap"]).rows for number in range(3)]
    assert found == [
        [(None, None, None)] * 2, [("calibrate", 12.0, "off")], [("verify", 5.0, "true")],
    ]  # fmt: skip


def test_a_store_without_plans_can_be_asked_for_them(tmp_path):
    table = fill(tmp_path / "s", 0.8).read().table
    assert query(table, "SELECT plan FROM results").rows == [(None,)]
