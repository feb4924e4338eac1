"""Recordings as tables."""

import csv
import io
import json
import os
import sys

import numpy as np
import pytest
from pyarrow import parquet
from scipy.io import loadmat

from motord.recording.errors import RecordError
from motord.recording.export import csv_text, export, matlab, mdf, parquet_file
from motord.recording.export.csv_text import csv_lines
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from tests.unit.recording.runs import METADATA, tick_block, truth_block, write_run


@pytest.fixture
def run(tmp_path):
    write_run(tmp_path / "run.mcap", 350, chunk_s=0.1)
    return open_run(tmp_path / "run.mcap")


@pytest.mark.parametrize("arrow", [True, False])
def test_csv_reads_back_bit_for_bit(run, tmp_path, monkeypatch, arrow):
    monkeypatch.setattr(csv_text, "CSV_ROWS", 150)
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


@pytest.mark.parametrize(
    "text", ["=1+1", "+a", "-a", "@SUM(A1)", "\t=1", "\r=1", "\n=1", "＝1", "-"]
)
def test_text_that_is_a_formula_to_a_spreadsheet_gets_an_apostrophe(text):
    line = csv_lines([[text, f"a{text}"]])
    assert next(csv.reader(io.StringIO(line, newline=""))) == [
        one.replace("\r", "\n") for one in (f"'{text}", f"a{text}")
    ]


def test_numbers_are_no_formulas():
    cells = [-1.5, "-1.5", "+3", "-inf", -2, True, None, "", "'=", "a-b"]
    assert csv_lines([cells]) == "-1.5,-1.5,+3,-inf,-2,True,,,'=,a-b\n"


def test_csv_has_no_formula_from_names_or_settings(tmp_path):
    settings = {"file": "=HYPERLINK(1)", "speed_Hz": -2.0}
    with RunWriter(
        tmp_path / "run.mcap", METADATA | {"plan": {"name": "@x", "settings": settings}}
    ) as writer:
        writer.ticks(tick_block(3))
    export(
        open_run(tmp_path / "run.mcap"),
        tmp_path / "run.csv",
        ("tick", "plan", "setting_file", "setting_speed_Hz"),
    )
    lines = (tmp_path / "run.csv").read_text().splitlines()
    assert lines[1] == "0,'@x,'=HYPERLINK(1),-2"


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
    monkeypatch.setattr(parquet_file, "ROW_GROUP_ROWS", 150)
    path = tmp_path / os.fsdecode(b"run\xff.parquet")
    assert export(run, path) == 350
    path = path.rename(tmp_path / "run.parquet")
    table, expected = parquet.read_table(path), tick_block(350)
    assert table.column_names == list(expected.dtype.names)
    for name in expected.dtype.names:
        assert table[name].to_numpy().tobytes() == expected[name].tobytes()
    assert table.schema.field("torque_Nm").metadata[b"unit"] == b"Nm"
    assert json.loads(table.schema.metadata[b"motord"])["motor"] == METADATA["motor"]
    assert parquet.ParquetFile(path).num_row_groups == 2


def test_mdf_reads_back_bit_for_bit_over_seconds_from_its_start(run, tmp_path, monkeypatch):
    monkeypatch.setattr(mdf, "GROUP_ROWS", 150)
    path, expected = tmp_path / "run.mf4", tick_block(350)
    assert export(run, path) == 350
    from asammdf import MDF  # 0.4 s, of whoever collects

    with MDF(path) as read:
        assert read.start_time.timestamp() == pytest.approx(expected["t_ns"][0] * 1e-9, abs=1e-6)
        for name in expected.dtype.names:
            channel = read.get(name)
            assert channel.samples.tobytes() == expected[name].tobytes()
            since_s = (expected["t_ns"] - expected["t_ns"][0]) * 1e-9
            np.testing.assert_array_equal(channel.timestamps, since_s)
        assert read.get("torque_Nm").unit == "Nm"
        assert "torque" in read.get("torque_Nm").comment.lower()
        assert json.loads(read.header.description)["motor"] == METADATA["motor"]


def test_mdf_has_the_columns_chosen_and_needs_the_time(run, tmp_path):
    export(run, tmp_path / "run.mf4", ["torque_Nm", "t_ns"])
    from asammdf import MDF

    with MDF(tmp_path / "run.mf4") as read:
        assert set(read.channels_db) == {"torque_Nm", "t_ns", "time"}
    with pytest.raises(RecordError, match="needs the time of each row: let --columns have t_ns"):
        export(run, tmp_path / "other.mf4", ["torque_Nm"])


def test_matlab_reads_back_bit_for_bit(run, tmp_path):
    path, expected = tmp_path / "run.mat", tick_block(350)
    assert export(run, path) == 350
    read = loadmat(path, squeeze_me=True, struct_as_record=False)["motord"]
    for name in expected.dtype.names:
        column = getattr(read.ticks, name)
        assert column.dtype == expected.dtype[name]
        assert column.tobytes() == expected[name].tobytes()
    assert read.units.torque_Nm == "Nm"
    assert read.meanings.torque_Nm
    assert json.loads(read.metadata)["motor"] == METADATA["motor"]


def test_more_than_a_matlab_file_can_hold_is_refused(run, tmp_path, monkeypatch):
    monkeypatch.setattr(matlab, "BYTES_MAX", 350 * 8 - 1)
    with pytest.raises(RecordError, match=r"run.mat: a .mat file holds at most .*--columns"):
        export(run, tmp_path / "run.mat", ["t_ns"])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.mcap"]
    assert export(run, tmp_path / "run.mat", ["torque_Nm"]) == 350


@pytest.mark.parametrize("suffix", ["csv", "parquet", "mf4", "mat"])
def test_a_run_without_ticks_is_an_empty_table(tmp_path, suffix):
    RunWriter(tmp_path / "run.mcap", {}).close()
    assert export(open_run(tmp_path / "run.mcap"), tmp_path / f"run.{suffix}", ["t_ns"]) == 0


@pytest.mark.parametrize(
    ("package", "extra", "suffix"), [("pyarrow", "parquet", "parquet"), ("asammdf", "mdf", "mf4")]
)
def test_a_package_that_is_missing_is_named(run, tmp_path, monkeypatch, package, extra, suffix):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(RecordError, match=rf"pip install 'motord\[{extra}\]'; or choose a name"):
        export(run, tmp_path / f"run.{suffix}")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.mcap"]


def test_mistakes_are_reported_and_leave_nothing_behind(run, tmp_path):
    taken = tmp_path / "taken.csv"
    taken.write_text("precious")
    for output, columns, message in (
        (tmp_path / "run.xlsx", None, "must end with .csv, .parquet, .mf4 or .mat"),
        (taken, None, "exists already"),
        (tmp_path / "run.csv", ["volts"], "Tick has no column volts"),
        (
            tmp_path / "absent" / "run.csv",
            None,
            r"run\.csv: .* no folder .*absent; make it",
        ),
    ):
        with pytest.raises(RecordError, match=message):
            export(run, output, columns)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.mcap", "taken.csv"]
    assert taken.read_text() == "precious"
