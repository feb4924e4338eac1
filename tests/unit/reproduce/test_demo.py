"""The demo: its table and files, at the same bounds quick and whole; what `reproduce` refuses, too.

Quick in this process, whole as a user runs it.
"""

import json
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from motord import calibration
from motord.cli import app
from motord.config import load as load_bench
from motord.recording.reader import open_run
from motord.reproduce.bench import SimulatedBench
from motord.reproduce.demo import FILES
from motord.reproduce.evaluate import evaluate
from motord.simulate import PlanSource
from motord.virtual.mesh import processors

RUNNER = CliRunner()


@dataclass(frozen=True)
class Extent:
    """How many points the meshes of a demo have, and its least time on the bench."""

    points: int
    bench_s: float


QUICK, WHOLE = Extent(4, 200.0), Extent(30, 3000.0)


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("demo")
    for name in (*FILES.values(), "demo.json", "calibrate.mcap.part"):
        (folder / name).write_text("of an earlier demo")
    done = RUNNER.invoke(app, ["demo", "--quick", "--out", str(folder)])
    assert done.exit_code == 0, done.output
    return folder, done.output


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(QUICK, id="quick"),
        pytest.param(WHOLE, id="whole", marks=pytest.mark.long),
    ],
)
def extent(request: pytest.FixtureRequest) -> Extent:
    return request.param


@pytest.fixture(scope="module")
def demo(
    extent: Extent, quick: tuple[Path, str], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any]]:
    if extent is QUICK:
        return quick[0], json.loads((quick[0] / "demo.json").read_text())
    folder = tmp_path_factory.mktemp("whole") / "out"
    command = [sys.executable, "-m", "motord", "demo", "--out", folder, "--json", "--seed", "7"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


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


def test_as_json_it_prints_what_demo_json_has(monkeypatch: pytest.MonkeyPatch) -> None:
    made = SimpleNamespace(summary={"points": [1.5]})
    monkeypatch.setattr("motord.reproduce.demo.run_demo", lambda *_: made)
    monkeypatch.setattr("motord.reproduce.demo.write_report", lambda _: None)
    done = RUNNER.invoke(app, ["demo", "--json"])
    assert json.loads(done.stdout) == made.summary


def test_ripple_before_and_after(demo: tuple[Path, dict[str, Any]], extent: Extent) -> None:
    _, found = demo
    assert len(found["points"]) == extent.points
    assert 5.0 < found["before"]["mean"] < 9.0
    # a tenth of this would be too good to be true at 1 kHz: sampled currents alone leave more
    assert 0.05 < found["after"]["max"] <= 0.5
    for point in found["points"]:
        assert point["before"] > 5.0
        assert 0.02 < point["after"] <= 0.5


def test_estimates_against_the_truth(demo: tuple[Path, dict[str, Any]]) -> None:
    _, found = demo
    truth, joint, residual = found["truth"], found["joint"], found["residual"]
    assert truth["alpha"] == [0.8, 1.118, 1.118]
    assert truth["beta_A"] == [1.0, -0.5, -0.5]
    assert joint["alpha"] == pytest.approx(truth["alpha"], rel=0.005)
    assert joint["beta_A"] == pytest.approx(truth["beta_A"], abs=0.02)
    worst = max(abs(a / b - 1) for a, b in zip(residual["alpha"], truth["alpha"], strict=True))
    assert 0.02 < worst < 0.08  # the bias that the joint estimator is there to avoid
    orders = {h["order"]: h["amplitude_Nm"] for h in joint["tau_cog_harmonics"]}
    for harmonic in truth["tau_cog_harmonics"]:
        assert orders[harmonic["order"]] == pytest.approx(harmonic["amplitude_Nm"], abs=1e-3)


def test_files_can_be_used(demo: tuple[Path, dict[str, Any]], extent: Extent) -> None:
    folder, found = demo
    assert found["bench_s"] > extent.bench_s
    # of the calibration two more, with one phase's current scaled
    for name, more in (("verify-off.mcap", 0), ("calibrate.mcap", 2), ("verify-on.mcap", 0)):
        run = open_run(folder / name)
        assert run.check() is None
        assert len(run.operating_points()) == extent.points + more
    made = calibration.load(folder / "calibration.json")
    made.check_motor(load_bench().motor)
    assert made.rms_error_percent.before is not None
    assert made.rms_error_percent.before.mean > 5.0
    assert made.rms_error_percent.after is not None
    report = (folder / "report.html").read_text()
    assert "<img" in report or "<svg" in report
    for outside in ("http://", "https://", 'src="/', "@import"):
        assert outside not in report.replace("http://www.w3.org", ""), outside


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


@pytest.mark.parametrize("name", ["calibrate.mcap", "calibration.json", "report.html"])
def test_files_of_no_demo_are_not_overwritten(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    done = RUNNER.invoke(app, ["demo", "--quick", "--out", str(tmp_path)])
    assert done.exit_code == 1
    assert f"{tmp_path / name}: is of no demo and would be lost" in done.stderr
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "mine")]


def test_what_reproduce_left_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "reproduce.html").write_text("of before")
    done = RUNNER.invoke(app, ["reproduce", "--quick", "--out", str(tmp_path)])
    assert done.exit_code == 1
    assert "is not empty" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
