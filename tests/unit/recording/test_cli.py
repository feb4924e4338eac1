"""`motord record` from the command line."""

import json

import pytest
from typer.testing import CliRunner

from motord.cli.record.commands import app
from motord.recording.file_names import part_of
from motord.recording.writer import RunWriter
from tests.unit.recording.runs import METADATA, point_of, tick_block, write_run


def call(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code == code, result.output
    return result.stderr if code else result.stdout


@pytest.fixture
def run(tmp_path):
    write_run(tmp_path / "run.mcap", 600)
    return tmp_path / "run.mcap"


@pytest.fixture
def unfinished(tmp_path):
    writer = RunWriter(tmp_path / "cut.mcap", METADATA)
    writer.ticks(tick_block(100))
    writer.abandon()
    return part_of(tmp_path / "cut.mcap")


def test_info_of_a_whole_run(run):
    text = call("info", run)
    assert "600 in 0.599 s (1000.0 Hz)" in text
    assert "AFPM-6" in text
    assert "missing:          nothing" in text
    facts = json.loads(call("info", run, "--json", "--check"))
    assert facts["ticks"] == 600
    assert (facts["tick_first"], facts["tick_last"], facts["ticks_missing"]) == (0, 599, 0)
    assert (facts["events"], facts["plan_messages"]) == (1, 1)
    assert facts["operating_points"][0]["torque_Nm"] == 3.0
    assert facts["damage"] is None
    assert "torque_Nm" in facts["columns"]


def test_info_counts_no_missing_ticks_where_the_counter_began_anew(tmp_path):
    with RunWriter(tmp_path / "run.mcap", METADATA) as writer:
        writer.ticks(tick_block(200))
        writer.event(0, "loop_restarted", "its counter begins anew with tick 0", {"tick_after": 0})
        writer.ticks(tick_block(100))
    assert json.loads(call("info", tmp_path / "run.mcap", "--json"))["ticks_missing"] is None
    assert "without a tick" not in call("info", tmp_path / "run.mcap")


def test_info_passes_over_an_event_of_timing_that_another_program_wrote(tmp_path):
    with RunWriter(tmp_path / "run.mcap", METADATA) as writer:
        writer.ticks(tick_block(100))
        for data in ({"missed": "many"}, {"missed": 3}):
            writer.event(0, "timing", "", data)
    facts = json.loads(call("info", tmp_path / "run.mcap", "--json"))
    assert facts["timing"]["missed"] == 3


def test_info_of_several_runs_goes_on_after_one_that_cannot_be_read(run, unfinished, tmp_path):
    nothing = tmp_path / "nothing.mcap"
    result = CliRunner().invoke(app, ["info", str(run), str(nothing), str(unfinished)])
    assert (result.exit_code, result.stdout.count("ticks:  ")) == (1, 2)
    assert result.stdout.index(str(run)) < result.stdout.index(str(unfinished))
    assert f"{nothing}: " in result.stderr
    facts = json.loads(call("info", run, unfinished, "--json"))
    assert [one["file"] for one in facts] == [str(run), str(unfinished)]


def test_info_of_a_calibration_run(tmp_path):
    plan = {"name": "calibrate", "settings": {}}
    metadata = {**METADATA, "motor": {"name": "AFPM-7", "serial": "47"}, "plan": plan}
    block = tick_block(100)
    with RunWriter(tmp_path / "run.mcap", metadata) as writer:
        writer.ticks(block[block["tick"] != 50])
        point = point_of(block) | {"speed_Hz": 0.7, "turns": 24.0}
        writer.operating_point(int(block["t_ns"][-1]), point)
    text = call("info", tmp_path / "run.mcap")
    assert "AFPM-7, serial 47" in text
    for part in ("calibrate", "99 in", "1 periods without a tick", " 3 Nm  0.700 Hz"):
        assert part in text


@pytest.mark.parametrize(
    ("metadata", "expected"),
    [
        ({"calibration": "8f2c"}, "8f2c\n"),
        ({"calibration": "8f2c", "calibration_findings": []}, "8f2c\n"),
        ({"calibration": "8f2c", "calibration_findings": ["kirchhoff", "few turns"]},
         "8f2c, in spite of kirchhoff, few turns\n"),
    ],
)  # fmt: skip
def test_info_says_which_findings_were_accepted(tmp_path, metadata, expected):
    with RunWriter(tmp_path / "run.mcap", metadata) as writer:
        writer.ticks(tick_block(1))
    assert f"calibration:      {expected}" in call("info", tmp_path / "run.mcap")


def test_info_of_an_empty_run(tmp_path):
    RunWriter(tmp_path / "run.mcap", {}).close()
    assert "ticks:            none" in call("info", tmp_path / "run.mcap")
    RunWriter(tmp_path / "cut.mcap", {}).abandon()
    assert json.loads(call("info", part_of(tmp_path / "cut.mcap"), "--json"))["ticks"] == 0


def test_info_of_one_tick(tmp_path):
    with RunWriter(tmp_path / "run.mcap", {}) as writer:
        writer.ticks(tick_block(1))
    assert json.loads(call("info", tmp_path / "run.mcap", "--json"))["rate_Hz"] is None
    assert "1 in 0.000 s" in call("info", tmp_path / "run.mcap")


def test_an_unfinished_run_is_recovered(unfinished, tmp_path):
    facts = json.loads(call("info", unfinished, "--json"))
    assert facts["ticks"] == 100
    assert "not closed" in facts["damage"]
    result = json.loads(call("recover", unfinished, "--json"))
    assert result["file"] == str(tmp_path / "cut.recovered.mcap")
    assert (result["ticks"], result["chunks"]) == (100, 1)
    text = call("info", result["file"])
    assert "recovered:        from cut.mcap.part; lost: the recording was not closed; any" in text
    text = call("recover", unfinished, "-o", tmp_path / "again.mcap")
    assert "again.mcap: 100 ticks in 1 chunks" in text
    assert "already" in call("recover", unfinished, "-o", tmp_path / "again.mcap", code=1)


def test_a_whole_run_needs_no_recovery(run, tmp_path):
    assert "is whole: nothing to recover" in call("recover", run)
    assert json.loads(call("recover", run, "--json")) == {"file": str(run), "damage": None}
    assert [p.name for p in tmp_path.iterdir()] == ["run.mcap"]


def test_export(run, unfinished, tmp_path):
    assert "run.csv: 600 rows" in call("export", run, "--columns", "t_ns, torque_Nm")
    assert (tmp_path / "run.csv").read_text().startswith("t_ns,torque_Nm\n")
    result = json.loads(call("export", run, "-o", tmp_path / "t.parquet", "--truth", "--json"))
    assert result == {"file": str(tmp_path / "t.parquet"), "rows": 600, "damage": None}
    result = CliRunner().invoke(app, ["export", str(unfinished), "-o", str(tmp_path / "u.csv")])
    assert (result.exit_code, "not closed" in result.stderr) == (0, True)
    said = call("export", unfinished, "-o", tmp_path / "v.csv", "--truth", code=1)
    assert "there is no truth in it" in said
    assert not list(tmp_path.glob("v.csv*"))


@pytest.mark.parametrize("command", ["info", "recover", "export"])
def test_what_cannot_be_read_is_one_line_on_stderr(tmp_path, command):
    path = tmp_path / "notes.mcap"
    path.write_text("not a recording")
    message = call(command, path, code=1)
    assert message == f"motord: {path}: is not an MCAP file\n"
    assert call(command, code=2)
