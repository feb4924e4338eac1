"""The plan of a recording as columns of tables."""

import csv

import pytest
from pyarrow import parquet
from scipy.io import loadmat

from motord.recording.errors import RecordError
from motord.recording.export import export
from motord.recording.plan_columns import as_text, common_columns, plan_columns
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from tests.unit.recording.runs import tick_block

ODD = 'C:\\cycles, "new"\nnight é'
PLAN = {
    "name": "profile",
    "settings": {
        "file": ODD, "turns": 12, "settle_s": 0.1, "check": True, "torques_Nm": [1.0, -2.5],
        "inner": {"turns": 3}, "nothing": None,
    },
}  # fmt: skip
COLUMNS = {
    "plan": "profile", "setting_file": ODD, "setting_turns": 12.0, "setting_settle_s": 0.1,
    "setting_check": True, "setting_torques_Nm": "[1.0,-2.5]", "setting_inner_turns": 3.0,
}  # fmt: skip


def test_settings_are_columns_with_their_units():
    found = plan_columns({"plan": PLAN})
    assert found == COLUMNS
    assert list(map(type, found.values())) == list(map(type, COLUMNS.values()))


@pytest.mark.parametrize(
    ("metadata", "found"),
    [
        ({}, {}),
        ({"plan": {}}, {}),
        ({"plan": None}, {}),
        ({"plan": [1]}, {}),
        ({"plan": "verify"}, {"plan": "verify"}),
        ({"plan": {"name": "x", "settings": "odd"}}, {"plan": "x"}),
        ({"plan": {"name": "\ud800"}}, {"plan": "?"}),
        ({"plan": {"name": "x", "settings": {"n": 2**53 + 1}}},
         {"plan": "x", "setting_n": "9007199254740993"}),
        ({"plan": {"name": "x", "settings": {"a b": 1, "a-b": 2, "A_b": 3}}},
         {"plan": "x", "setting_a_b": 1.0, "setting_a_b_2": 2.0, "setting_A_b_3": 3.0}),
    ],
)  # fmt: skip
def test_any_metadata_give_columns_or_none(metadata, found):
    assert plan_columns(metadata) == found


def test_names_are_as_long_as_matlab_takes_them_and_differ():
    found = plan_columns({"plan": {"name": "x", "settings": {"n" * 80 + c: 1 for c in "ab"}}})
    assert [len(name) for name in found] == [4, 63, 63]


def test_numbers_read_back():
    values = (0.1, 12.0, 1e300, -3.0)
    assert [float(as_text(one)) for one in values] == list(values)
    assert [as_text(one) for one in (12.0, True, "a")] == ["12", "true", "a"]


def test_of_several_recordings_what_they_have_in_common():
    one, other = dict(COLUMNS), {**COLUMNS, "plan": "verify", "setting_turns": 3.0}
    del other["setting_check"]
    both = common_columns([one, other])
    assert both["plan"] == "profile, verify"
    assert set(one) - set(both) == {"setting_turns", "setting_check"}
    assert common_columns([one, {}]) == {"plan": "profile"}
    assert common_columns([{}, {}]) == common_columns([]) == {}


@pytest.fixture
def run(tmp_path):
    with RunWriter(tmp_path / "run.mcap", {"plan": PLAN}) as writer:
        writer.ticks(tick_block(30))
    return open_run(tmp_path / "run.mcap")


@pytest.mark.parametrize("columns", [None, ["setting_file", "tick", "plan"]])
def test_a_csv_has_them_after_the_ticks_in_every_row(run, tmp_path, columns):
    export(run, tmp_path / "run.csv", columns)
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["tick"] for row in rows] == [str(tick) for tick in range(30)]
    assert {row["setting_file"] for row in rows} == {ODD}
    shown = [name for name in rows[0] if name not in run.columns]
    assert shown == (["setting_file", "plan"] if columns else list(COLUMNS))


def test_parquet_has_them_as_typed_columns_that_cost_nothing(run, tmp_path):
    export(run, tmp_path / "run.parquet", ["tick", *COLUMNS])
    rows = parquet.read_table(tmp_path / "run.parquet").to_pylist()
    assert rows == [{"tick": tick, **COLUMNS} for tick in range(30)]


def test_matlab_has_them_once(run, tmp_path):
    export(run, tmp_path / "run.mat")
    read = loadmat(tmp_path / "run.mat", squeeze_me=True, struct_as_record=False)["motord"]
    assert read.plan.setting_inner_turns == 3
    assert read.plan.setting_file == ODD


def test_a_channel_of_the_same_name_goes_first(tmp_path):
    with RunWriter(tmp_path / "run.mcap", {"plan": PLAN}) as writer:
        writer.channel(int(tick_block(1)["t_ns"][0]), "plan", "degC", 1.0, {"value": 5.0})
        writer.ticks(tick_block(2))
    export(open_run(tmp_path / "run.mcap"), tmp_path / "run.csv", ["plan", "setting_turns"])
    assert (tmp_path / "run.csv").read_text() == "plan,setting_turns\n5,12\n5,12\n"


def test_columns_of_the_plan_alone_are_no_table_of_ticks(run, tmp_path):
    with pytest.raises(RecordError, match="a column of each tick besides plan, setting_turns"):
        export(run, tmp_path / "run.csv", ["plan", "setting_turns"])


def test_a_mistyped_setting_gets_the_names_of_all(run, tmp_path):
    with pytest.raises(RecordError, match="no setting_turn; settings of its plan: plan, setting_"):
        export(run, tmp_path / "run.csv", ["tick", "setting_turn"])
