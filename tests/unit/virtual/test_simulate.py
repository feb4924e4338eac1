import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import SeekingReader
from typer.testing import CliRunner

from motord.cli import app, simulate
from motord.config import load, packaged
from motord.experiments import plans
from motord.recording.errors import RecordError
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.rig.build import build
from motord.rig.truth import RigTruth
from motord.simulate import PlanSource, record_plan
from motord.virtual import bench


def run(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["simulate", *(str(a) for a in arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


SETTINGS = ("torques_Nm=2", "speeds_Hz=1", "turns=3", "gain_steps=[]")
TWO_POINTS = {"torques_Nm": [2.0], "speeds_Hz": [0.9, 1.3], "turns": 2}
SMALL = tuple(argument for setting in SETTINGS for argument in ("--set", setting))


def test_a_plan_becomes_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    code, out, _ = run("calibrate", *SMALL, "-o", path, "--seed", 4, "--json")
    assert code == 0
    result = json.loads(out)
    assert (result["points"], result["seed"], result["run"]) == (1, 4, str(path))
    recorded = open_run(path)
    assert recorded.metadata["plan"]["name"] == "calibrate"
    assert recorded.metadata["plan"]["settings"]["turns"] == 3
    assert len(recorded.operating_points()) == 1
    assert recorded.ticks(["tick"]).size / 1000 == pytest.approx(result["bench_s"], abs=0.051)
    assert recorded.truth(["t_ns"]).size == recorded.ticks(["tick"]).size
    code, _, err = run("calibrate", *SMALL, "-o", path)
    assert code == 1
    assert "exists" in err


def test_ticks_and_truth_of_a_second_are_in_one_chunk(tmp_path: Path) -> None:
    plan = plans.build("verify", load(), {**TWO_POINTS, "compensate": "off"})
    path = tmp_path / "run.mcap"
    recorded = record_plan(PlanSource.of(), plan, path, 4)
    assert recorded.bench_s % 1 != 0  # the points begin and end within seconds
    with path.open("rb") as file:
        summary = SeekingReader(file).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) == math.ceil(recorded.bench_s)


def test_points_that_come_out_poor_are_counted(tmp_path: Path) -> None:
    settings = ("--set", "repeats=2", "--set", "torque_Nm=3", "--set", "start_speed_Hz=1.01")
    path = tmp_path / "run.mcap"
    code, out, _ = run("friction", *settings, "-o", path)
    assert code == 0
    assert out.rstrip().endswith(f"wrote {path}; 4 are poor: `motord record info {path}` says why")
    assert {point["quality"][:7] for point in open_run(path).operating_points()} == {"coasted"}
    assert json.loads(run("calibrate", *SMALL, "-o", tmp_path / "2.mcap", "--json")[1])["poor"] == 0


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("nothing",), "no plan 'nothing'; there are: align, calibrate"),
        (("verify",), "no calibration is named"),
        (("calibrate", "--set", "turns=0"), "setting turns"),
        (("calibrate", "--set", "torques_Nm=50"), "above [limits] torque_Nm"),
        (("calibrate", "-c", "/nowhere.toml"), "/nowhere.toml"),
        (("inertia-oscillation",), "the simulated rig has no bar on springs"),
        (("inertia-oscillation",), f"packaged one: -c {packaged('inertia.toml')}"),
        (("verify", "--calibration", "/nowhere.json"), "/nowhere.json"),
    ],
)
def test_what_cannot_be_simulated_is_said_in_a_line(
    arguments: tuple[str, ...], expected: str, tmp_path: Path
) -> None:
    code, _, err = run(*arguments, "-o", tmp_path / "run.mcap")
    assert code == 1
    assert expected in err
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_what_does_not_fit_on_the_disk_is_not_begun(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("motord.simulate.free_bytes", lambda folder: 1e9)
    code, _, err = run("calibrate", *SMALL, "--set", "settle_s=86400", "-o", tmp_path / "run.mcap")
    assert code == 1
    assert "shorten it, or name a file where there is more" in err


def test_a_long_plan_is_announced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulate, "LONG_S", 1.0)
    _, _, err = run("calibrate", *SMALL, "-o", tmp_path / "run.mcap")
    assert re.search(r"calibrate: about 0\.00\d+ h on the bench; its recording takes about", err)


@pytest.mark.parametrize(
    ("counts", "fault", "expected"),
    [(4097, "can_drop", "4097"), (4096, "bridge_clock", "bridge_clock is not possible here")],
)
def test_a_wrong_rig_file_or_fault_leaves_no_recording_behind(
    counts: int, fault: str, expected: str, tmp_path: Path
) -> None:
    rig = packaged("report.rig.toml").read_text().replace("counts = 4096", f"counts = {counts}")
    (tmp_path / "rig.toml").write_text(rig)
    (tmp_path / "faults.toml").write_text(f'[[fault]]\nkind = "{fault}"\n')
    text = packaged("sim.toml").read_text()
    files = 'rig = "rig.toml"\nfaults = "faults.toml"'
    (tmp_path / "bench.toml").write_text(re.sub(r"^rig = .*$", files, text, flags=re.M))
    path = tmp_path / "run.mcap"
    code, _, err = run("calibrate", *SMALL, "-c", tmp_path / "bench.toml", "-o", path)
    assert code == 1
    assert expected in err
    assert not list(tmp_path.glob("run.mcap*"))


def test_a_rig_is_built_for_each_point_and_none_to_check_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[RigTruth] = []

    def build_rig(truth: RigTruth, *arguments: object) -> tuple[np.ndarray, np.ndarray]:
        built.append(truth)
        return build(truth, *arguments)

    monkeypatch.setattr(bench, "build", build_rig)
    source = PlanSource.of()
    settings = {"torques_Nm": [2], "speeds_Hz": [1], "turns": 2, "gain_steps": []}
    plan = plans.build("calibrate", source.config, settings)
    record_plan(source, plan, tmp_path / "run.mcap", seed=1)
    assert len(built) == len(plan.points) == 1


def test_of_a_simulation_on_a_full_disk_there_is_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise RecordError("run.mcap.part: cannot write it: No space left on device")

    monkeypatch.setattr(RunWriter, "operating_point", full)
    source = PlanSource.of()
    settings = {"torques_Nm": [2], "speeds_Hz": [1], "turns": 2, "gain_steps": []}
    plan = plans.build("calibrate", source.config, settings)
    with pytest.raises(RecordError, match="No space"):
        record_plan(source, plan, tmp_path / "run.mcap", seed=1)
    assert not list(tmp_path.iterdir())
