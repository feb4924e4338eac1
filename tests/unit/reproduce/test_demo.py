"""The demo's quick form, in this process: its table, its files; what it and `reproduce` refuse."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from motord.calibration import load
from motord.cli import app
from motord.config import load as load_bench
from motord.reproduce.bench import SimulatedBench
from motord.reproduce.demo import FILES
from motord.reproduce.evaluate import evaluate
from motord.simulate import PlanSource
from motord.virtual.mesh import processors

RUNNER = CliRunner()


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("demo")
    for name in (*FILES.values(), "demo.json", "calibrate.mcap.part"):
        (folder / name).write_text("of an earlier demo")
    done = RUNNER.invoke(app, ["demo", "--quick", "--out", str(folder)])
    assert done.exit_code == 0, done.output
    return folder, done.output


def test_it_prints_before_and_after_and_where_things_are(quick: tuple[Path, str]) -> None:
    folder, output = quick
    assert "before→after" in output
    assert "worst point" in output
    assert "residual estimator (2008)" in output
    assert len(re.findall(r"(alpha|beta \(A\)) [abc] .* \+- .* \+- ", output)) == 6
    assert str(folder / "report.html") in output.replace("\n", "")


def test_what_it_leaves_in_place_of_an_earlier_one(quick: tuple[Path, str]) -> None:
    folder, _ = quick
    assert {path.name for path in folder.iterdir()} == {
        "verify-off.mcap", "calibrate.mcap", "verify-on.mcap",
        "calibration.json", "demo.json", "report.html",
    }  # fmt: skip
    found = json.loads((folder / "demo.json").read_text())
    assert len(found["points"]) == 4
    assert found["before"]["mean"] > 5.0
    assert 0.02 < found["after"]["max"] < 0.5
    assert load(folder / "calibration.json").rms_error_percent.after is not None


def test_the_interval_of_verify_holds_the_true_torque_between_the_ticks(
    quick: tuple[Path, str],
) -> None:
    for name in ("verify-off.mcap", "verify-on.mcap"):
        found = evaluate(load_bench(), quick[0] / name)
        assert len(found.ripples) == 4
        for one in found.ripples:
            assert one.stderr_percent is not None
            off = one.rms_percent - found.true_percent[one.torque_Nm, one.speed_Hz]
            assert abs(off) < 1.96 * one.stderr_percent


def test_another_seed_is_another_calibration_of_the_same_truth(tmp_path: Path) -> None:
    mesh = {"torques_Nm": [2.0, 4.0], "speeds_Hz": [0.9], "turns": 4}
    alphas, truths = [], []
    with processors() as pool:
        for seed in (1, 1, 2):
            bench = SimulatedBench(PlanSource.of(), pool, seed)
            path = tmp_path / f"{len(alphas)}.mcap"
            run = bench.record("calibrate", mesh, path, lambda *_: None)
            alphas.append(np.array(bench.calibrate(run, lambda *_: None).joint.alpha))
            truths.append(bench.truth)
    assert (alphas[0] == alphas[1]).all()
    assert 1e-6 < np.abs(alphas[2] - alphas[0]).max() < 0.005
    assert truths[2] == truths[0]


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = RUNNER.invoke(app, ["demo", "--quick", "--out", str(tmp_path / "file" / "out")])
    assert done.exit_code == 1
    [said] = [line for line in done.stderr.splitlines() if line.startswith("motord: ")]
    assert said.endswith("choose another folder with --out")
    assert "Traceback" not in done.stderr


def test_what_reproduce_left_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "reproduce.html").write_text("of before")
    done = RUNNER.invoke(app, ["reproduce", "--quick", "--out", str(tmp_path)])
    assert done.exit_code == 1
    assert "is not empty" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
