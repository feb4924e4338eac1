"""Recordings as tables."""

import csv
import json
import sys

import numpy as np
import pytest
from pyarrow import parquet

from motord.recording import export as export_module
from motord.recording.errors import RecordError
from motord.recording.export import export
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from tests.unit.recording.runs import METADATA, tick_block, truth_block, write_run


@pytest.fixture
def run(tmp_path):
    write_run(tmp_path / "run.mcap", 350, chunk_s=0.1)
    return open_run(tmp_path / "run.mcap")


@pytest.mark.parametrize("arrow", [True, False])
def test_csv_reads_back_bit_for_bit(run, tmp_path, monkeypatch, arrow):
    monkeypatch.setattr(export_module, "CSV_ROWS", 150)
    if not arrow:
        monkeypatch.setitem(sys.modules, "pyarrow", None)
    path = tmp_path / "run.csv"
    assert export(run, path) == 350
    expected = tick_block(350)
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(expected.dtype.names)
    for name in expected.dtype.names:
        column = np.array([row[name] for row in rows]).astype(expected.dtype[name])
        finite = expected[name] == expected[name]
        np.testing.assert_array_equal(column, expected[name])
        assert column[finite].tobytes() == expected[name][finite].tobytes()


def test_csv_has_the_columns_chosen_in_their_order(run, tmp_path):
    export(run, tmp_path / "run.csv", (name for name in ("torque_Nm", "tick")))
    assert (tmp_path / "run.csv").read_text().splitlines()[0] == "torque_Nm,tick"


@pytest.mark.parametrize("arrow", [True, False])
def test_truth_is_a_table_too(run, tmp_path, monkeypatch, arrow):
    if not arrow:
        monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert export(run, tmp_path / "truth.csv", ["angle_rad"], truth=True) == 350
    values = (tmp_path / "truth.csv").read_text().split()
    assert [float(v) for v in values[1:]] == truth_block(350)["angle_rad"].tolist()


def test_parquet_reads_back_bit_for_bit(run, tmp_path, monkeypatch):
    monkeypatch.setattr(export_module, "ROW_GROUP_ROWS", 150)
    path = tmp_path / "run.parquet"
    assert export(run, path) == 350
    table, expected = parquet.read_table(path), tick_block(350)
    assert table.column_names == list(expected.dtype.names)
    for name in expected.dtype.names:
        assert table[name].to_numpy().tobytes() == expected[name].tobytes()
    assert table.schema.field("torque_Nm").metadata[b"unit"] == b"Nm"
    assert json.loads(table.schema.metadata[b"motord"])["motor"] == METADATA["motor"]
    assert parquet.ParquetFile(path).num_row_groups == 2


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_run_without_ticks_is_an_empty_table(tmp_path, suffix):
    RunWriter(tmp_path / "run.mcap", {}).close()
    assert export(open_run(tmp_path / "run.mcap"), tmp_path / f"run.{suffix}", ["tick"]) == 0


def test_parquet_without_pyarrow_says_what_to_install(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(RecordError, match=r"pip install 'motord\[parquet\]'; or choose a name"):
        export(run, tmp_path / "run.parquet")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.mcap"]


def test_mistakes_are_reported_and_leave_nothing_behind(run, tmp_path):
    taken = tmp_path / "taken.csv"
    taken.write_text("precious")
    for output, columns, message in (
        (tmp_path / "run.xlsx", None, "must end with .csv or .parquet"),
        (taken, None, "exists already"),
        (tmp_path / "run.csv", ["volts"], "Tick has no column volts"),
        (tmp_path / "absent" / "run.csv", None, "cannot write it: No such file"),
    ):
        with pytest.raises(RecordError, match=message):
            export(run, output, columns)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.mcap", "taken.csv"]
    assert taken.read_text() == "precious"
