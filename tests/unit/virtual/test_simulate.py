import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.config import packaged
from motord.recording.reader import open_run


def run(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["simulate", *(str(a) for a in arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


SETTINGS = ("torques_Nm=2", "speeds_Hz=1", "turns=3", "gain_steps=[]")
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
    assert recorded.ticks(["tick"]).size == round(result["bench_s"] * 1000)
    assert recorded.truth(["t_ns"]).size == recorded.ticks(["tick"]).size
    code, _, err = run("calibrate", *SMALL, "-o", path)
    assert code == 1
    assert "exists" in err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("nothing",), "no plan 'nothing'; there are: align, calibrate"),
        (("verify",), "no calibration is named"),
        (("calibrate", "--set", "turns=0"), "setting turns"),
        (("calibrate", "--set", "torques_Nm=50"), "above [limits] torque_Nm"),
        (("calibrate", "-c", "/nowhere.toml"), "/nowhere.toml"),
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


def test_a_wrong_rig_file_leaves_no_recording_behind(tmp_path: Path) -> None:
    rig = packaged("report.rig.toml").read_text().replace("counts = 4096", "counts = 4097")
    (tmp_path / "rig.toml").write_text(rig)
    bench = packaged("sim.toml").read_text()
    bench = re.sub(r"^rig = .*$", 'rig = "rig.toml"', bench, flags=re.M)
    (tmp_path / "bench.toml").write_text(bench)
    path = tmp_path / "run.mcap"
    code, _, err = run("calibrate", *SMALL, "-c", tmp_path / "bench.toml", "-o", path)
    assert code == 1
    assert "4097" in err
    assert not list(tmp_path.glob("run.mcap*"))
