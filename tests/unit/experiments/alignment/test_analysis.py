"""Recordings of `align` through analysis, command line, bench file and report."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet
from typer.testing import CliRunner

from motord.cli import app
from motord.config import Config, MotorConfig, load, packaged
from motord.control.types import SETPOINT
from motord.experiments.alignment.command import found_alignment
from motord.experiments.plans import build
from motord.experiments.subject import Subject
from motord.identification.operating_points import PointData
from motord.recording.metadata import describe
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan
from tests.support.virtual_calibration import calibrate
from tests.support.wrong_signals import CHANGES, change_recording

TRUTH = """
[encoder]
counts = 4096
offset_rad = 4.4
direction = -1
"""
SHORT = ("--set", "turns=1", "--set", "rests=17")


def motord(*arguments: object):
    return CliRunner().invoke(app, [*map(str, arguments)])


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bench whose encoder and phases are not what its file says, and a run of the plan."""
    folder = tmp_path_factory.mktemp("align")
    truth = packaged("report.rig.toml").read_text()
    truth = truth.replace("\n[encoder]\ncounts = 4096\n", TRUTH)
    truth = truth.replace("[inverter]\n", '[inverter]\nphase_order = "acb"\n')
    (folder / "rig.toml").write_text(truth)
    text = packaged("sim.toml").read_text().replace('"report.rig.toml"', '"rig.toml"')
    (folder / "bench.toml").write_text(text)
    done = motord(
        "simulate", "align", "-c", folder / "bench.toml", "-o", folder / "run.mcap", *SHORT
    )
    assert done.exit_code == 0, done.output
    return folder


def test_what_is_found_is_written_into_the_bench_file(bench: Path, tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text((bench / "bench.toml").read_text())
    done = motord(
        "analyse", "align", bench / "run.mcap", "--write", path,
        "-o", tmp_path / "r.json", "--report", tmp_path / "r.html",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert 'phase_order = "acb"' in done.output
    assert "encoder_direction = -1" in done.output
    assert "the bench file has it otherwise" in done.output
    assert f"wrote {path}" in done.output
    assert "bench.toml has it now: start the daemon anew" in done.output
    assert "write what was found" not in done.output
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["schema"] == "motord.align/1"
    assert result["torque_sensor"]["shows_direction"] is True
    written = tomllib.loads(path.read_text())["motor"]
    assert {name: written[name] for name in result["fields"]} == result["fields"]
    assert result["accuracy_fields"] == tomllib.loads(path.read_text())["accuracy"]
    limit_rad = result["accuracy_fields"]["encoder_zero_rad"]
    assert f"[accuracy]\nencoder_zero_rad = {limit_rad}  # limit +-a" in done.output
    assert f"wrote {path}: [motor] and [accuracy] encoder_zero_rad" in done.output
    assert load(path).accuracy.model_fields_set == {"encoder_zero_rad"}
    turn_rad = np.pi / 4
    off_rad = (written["encoder_offset_rad"] - 4.4 + turn_rad / 2) % turn_rad - turn_rad / 2
    assert abs(off_rad) < 3 * result["encoder_offset_stderr_rad"] < 0.003
    page = (tmp_path / "r.html").read_text()
    assert page.count("<figure>") == 3
    assert "<td>acb</td><td>abc</td>" in page
    assert "<td>encoder_direction</td><td>-1</td><td>1</td>" in page
    assert f"encoder_zero_rad = {limit_rad}" in page


def test_the_file_that_is_written_is_no_setting_of_what_is_stored(
    bench: Path, tmp_path: Path
) -> None:
    (tmp_path / "a.toml").write_text((bench / "bench.toml").read_text())
    (tmp_path / "b.toml").write_text((bench / "bench.toml").read_text() + "\n# another\n")
    for name, new in (("a.toml", True), ("b.toml", False)):
        done = motord(
            "analyse", "align", bench / "run.mcap", "--write", tmp_path / name,
            "--store", tmp_path / "store",
        )  # fmt: skip
        assert done.exit_code == 0
        assert done.stderr.startswith("stored ") == new
    [stored] = (tmp_path / "store").iterdir()
    rows = parquet.read_table(stored).to_pylist()
    [zero] = [row for row in rows if row["field"] == "encoder_offset_rad"]
    assert zero["settings"] == "{}"
    assert 0 < zero["stderr"] < zero["high"] - zero["value"]


def test_a_limit_of_the_zero_that_was_stated_is_replaced_and_comments_stay(
    bench: Path, tmp_path: Path
) -> None:
    path = tmp_path / "bench.toml"
    stated = "[accuracy]  # data sheets\nencoder_zero_rad = 0.01  # by eye\n"
    path.write_text(f"{(bench / 'bench.toml').read_text()}\n{stated}back_emf_percent = 0.1\n")
    assert motord("analyse", "align", bench / "run.mcap", "--write", path).exit_code == 0
    written = load(path).accuracy
    assert (written.encoder_zero_rad < 0.005, written.back_emf_percent) == (True, 0.1)
    lines = path.read_text().splitlines()
    assert lines[-3:] == [
        "[accuracy]  # data sheets",
        f"encoder_zero_rad = {written.encoder_zero_rad}  # by eye",
        "back_emf_percent = 0.1",
    ]


def test_the_bench_calibrates_then_as_if_it_had_been_right(bench: Path, tmp_path: Path) -> None:
    path = bench / "aligned.toml"
    path.write_text((bench / "bench.toml").read_text())
    assert motord("analyse", "align", bench / "run.mcap", "--write", path).exit_code == 0
    config = load(path)
    found = _calibrated(config)
    assert found.alpha == pytest.approx((0.8, 1.118, 1.118), rel=0.005)
    assert found.beta_A == pytest.approx((1.0, -0.5, -0.5), abs=0.03)
    amplitude_Nm = {h.order: h.amplitude_Nm for h in found.harmonics}
    assert amplitude_Nm[48] == pytest.approx(0.33, rel=0.02)


def _calibrated(config: Config):
    bench = VirtualBench(config, seed=5)
    mesh = {"torques_Nm": [2, 4], "speeds_Hz": [0.8], "turns": 6, "settle_s": 1, "gain_steps": []}
    blocks: list[np.ndarray] = []
    points = run_plan(
        bench, build("calibrate", config, mesh), lambda ticks, _: blocks.append(ticks)
    )
    ticks = np.concatenate(blocks)
    data = [
        PointData(p["torque_Nm"], p["speed_Hz"], ticks[ticks["plan_point"] == p["index"]])
        for p in points
    ]
    return calibrate(data, config.motor, config.torque_sensor)


@pytest.mark.parametrize(
    ("off_points", "expected"), [(0.0, "right, its zero within 0.00"), (4.0, "zero is +4.0")]
)
def test_a_bench_file_that_is_right_or_nearly(
    bench: Path, off_points: float, expected: str
) -> None:
    run = open_run(bench / "run.mcap")
    found = found_alignment([run], Subject.of_runs([run]))
    motor = load(bench / "bench.toml").motor.model_dump() | found.fields
    offset_rad = found.offset_rad + off_points * 2 * np.pi / 4096
    motor["encoder_offset_rad"] = offset_rad
    again = replace(found, motor=MotorConfig.model_validate(motor))
    assert expected in again.agreement
    assert [one.name for one in again.findings] == ["bench-file-differs"] * (off_points > 0)


def test_the_result_is_json(bench: Path) -> None:
    done = motord("analyse", "align", bench / "run.mcap", "--json")
    assert json.loads(done.output)["rests_left_out"] < 10


def test_findings_of_a_mute_torque_sensor_odd_scales_and_swings(bench: Path) -> None:
    run = open_run(bench / "run.mcap")
    found = found_alignment([run], Subject.of_runs([run]))
    odd = replace(
        found,
        torque_response=replace(found.torque_response, direction=0),
        gains=(1.0, 1.3, 1.0),
        offset_stderr_rad=0.002,
        left_out=found.rests.size // 2,
    )
    text = " ".join(one.to_text() for one in odd.findings)
    assert "does not show the rotor's oscillations" in text
    assert "phase b: sensed current is 1.30 times the commanded one" in text
    assert "stops are left out" in text
    assert "the zero is not known well" in text


def test_counts_out_of_range_are_left_out_and_said(bench: Path, tmp_path: Path) -> None:
    change = CHANGES["encoder out of range at times"]
    runs = [
        open_run(bench / "run.mcap"),
        open_run(change_recording(bench / "run.mcap", tmp_path / "run.mcap", change)),
    ]
    sound, found = (found_alignment([run], Subject.of_runs([run])) for run in runs)
    assert "encoder-out-of-range" in {one.name for one in found.findings}
    assert found.offset_rad == pytest.approx(sound.offset_rad, abs=0.1 * sound.offset_stderr_rad)


def test_other_recordings_are_refused_in_one_line(bench: Path, tmp_path: Path) -> None:
    done = motord(
        "simulate", "verify", "-o", tmp_path / "v.mcap", "--set", "compensate=off",
        "--set", "torques_Nm=3", "--set", "speeds_Hz=1", "--set", "turns=2",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    done = motord("analyse", "align", tmp_path / "v.mcap")
    assert done.exit_code == 1
    assert "is of the plan verify; needed: align" in done.stderr
    (tmp_path / "motorless.toml").write_text("[bench]\n")
    done = motord("analyse", "align", bench / "run.mcap", "--write", tmp_path / "motorless.toml")
    assert done.exit_code == 1
    assert "there is no table [motor] to write to" in done.stderr


def test_runs_that_were_ended_early_count_for_nothing(bench: Path, tmp_path: Path) -> None:
    config = load(bench / "bench.toml")
    ticks, _ = VirtualBench(config, seed=1).run(np.zeros(1, SETPOINT), 100)
    early = tmp_path / "early.mcap"
    metadata = describe(config, (bench / "bench.toml").read_text(), plan={"name": "align"})
    with RunWriter(early, metadata) as writer:
        writer.ticks(ticks)
    done = motord("analyse", "align", early)
    assert done.exit_code == 1
    assert "the plan was ended before a sweep was over: start it anew" in done.stderr
    assert motord("analyse", "align", early, bench / "run.mcap").exit_code == 0
