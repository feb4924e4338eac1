"""Slow channels in recordings: topics with clocks of their own, apart from the ticks."""

import csv

import numpy as np
import pytest
from mcap.reader import make_reader

from motord.recording.errors import RecordError
from motord.recording.export import export
from motord.recording.info import describe
from motord.recording.reader import open_run
from motord.recording.recovery import recover
from motord.recording.writer import RunWriter
from tests.unit.recording.runs import METADATA, START_NS, tick_block, write_run

MS = 1_000_000
READINGS = [(0, 20.5), (100, 21.0), (200, None), (250, 22.0)]


def write(path, finish=True):
    writer = RunWriter(path, METADATA, chunk_s=0.1)
    ticks = tick_block(600)
    for number, (at_ms, value) in enumerate(READINGS):
        content = {"value": value, "raw": number, "status": "ok" if value else "broken"}
        writer.channel(START_NS + (at_ms - 50) * MS, "winding_C", "degC", 0.2, content)
        writer.ticks(ticks[150 * number : 150 * (number + 1)])
    writer.channel(START_NS, "power_W", "W", 60.0, {"value": 1, "status": "ok"})
    writer.channel(START_NS - MS, "power_W", "W", 60.0, {"value": 0, "status": "ok"})
    writer.close() if finish else writer.abandon()
    return path


@pytest.fixture
def run(tmp_path):
    return open_run(write(tmp_path / "run.mcap"))


def test_a_channel_is_read_back_in_the_order_of_its_times(run):
    times_ns, values = run.channel("winding_C")
    assert times_ns.dtype == np.int64
    np.testing.assert_array_equal(times_ns, [START_NS + (at - 50) * MS for at, _ in READINGS])
    np.testing.assert_array_equal(values, [20.5, 21.0, np.nan, 22.0])
    np.testing.assert_array_equal(run.channel("power_W")[1], [0.0, 1.0])
    assert {name: (one.unit, one.timeout_s) for name, one in run.channels().items()} == {
        "winding_C": ("degC", 0.2), "power_W": ("W", 60.0),
    }  # fmt: skip
    with pytest.raises(RecordError, match="has no channel oil; it has winding_C, power_W"):
        run.channel("oil")


def test_other_readers_find_a_topic_with_numbers(run):
    with run.path.open("rb") as file:
        found = [
            (message.log_time, message.data)
            for _, _, message in make_reader(file).iter_messages(["/channel/winding_C"])
        ]
    assert found[0][0] == START_NS - 50 * MS
    assert b'"value":20.5' in found[0][1].replace(b" ", b"")


def test_a_column_that_is_asked_for_twice_is_exported_once(run, tmp_path):
    export(run, tmp_path / "run.csv", ["tick", "power_W", "tick", "power_W"])
    assert (tmp_path / "run.csv").read_text().splitlines()[0] == "tick,power_W"


def test_recordings_without_channels_have_none(tmp_path):
    write_run(tmp_path / "run.mcap", 20)
    run = open_run(tmp_path / "run.mcap")
    assert run.channels() == {}
    assert describe(run)["channels"] == []
    with pytest.raises(RecordError, match="it has none"):
        run.channel("winding_C")


def test_info_lists_them(run):
    assert describe(run)["channels"] == [
        {"name": "winding_C", "unit": "degC", "readings": 4},
        {"name": "power_W", "unit": "W", "readings": 2},
    ]


def test_an_unfinished_file_and_the_clean_one_have_them_too(tmp_path):
    part = write(tmp_path / "run.mcap", finish=False)
    recover(part.with_name("run.mcap.part"), tmp_path / "clean.mcap")
    for path in (part.with_name("run.mcap.part"), tmp_path / "clean.mcap"):
        assert open_run(path).channel("winding_C")[1].tolist()[:2] == [20.5, 21.0]
        assert open_run(path).channels()["winding_C"].unit == "degC"


def test_in_a_table_a_reading_holds_until_the_next_for_its_timeout(run, tmp_path):
    assert export(run, tmp_path / "run.csv") == 600
    with (tmp_path / "run.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [*tick_block(1).dtype.names, "winding_C", "power_W"]
    column = np.array([float(row["winding_C"] or "nan") for row in rows])
    expected = np.full(600, np.nan)
    expected[:50], expected[50:150], expected[200:401] = 20.5, 21.0, 22.0
    np.testing.assert_array_equal(column, expected)
    assert {row["power_W"] for row in rows} == {"1"}


def test_columns_are_chosen_by_name_and_have_units(run, tmp_path):
    export(run, tmp_path / "run.csv", ["power_W", "tick", "winding_C"])
    lines = (tmp_path / "run.csv").read_text().splitlines()
    assert lines[0] == "power_W,tick,winding_C"
    assert lines[1] == "1,0,20.5"
    export(run, tmp_path / "run.mf4")
    from asammdf import MDF  # 0.4 s, of whoever collects

    with MDF(tmp_path / "run.mf4") as mdf:
        assert mdf.get("winding_C").unit == "degC"
        assert mdf.get("winding_C").samples[0] == 20.5
    with pytest.raises(RecordError, match="oil"):
        export(run, tmp_path / "other.csv", ["oil"])
