"""`motord demo` as a user runs it, at the same bounds quick and whole; files that can be used."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from motord import calibration
from motord.config import load
from motord.recording.reader import open_run

pytestmark = pytest.mark.system


@dataclass(frozen=True)
class Extent:
    """Options of a demo, how many points its meshes have, and the least time on the bench."""

    options: tuple[str, ...]
    points: int
    bench_s: float


QUICK, WHOLE = Extent(("--quick",), 4, 200.0), Extent((), 30, 3000.0)


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
def demo(extent: Extent, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    folder = tmp_path_factory.mktemp("demo") / "out"
    command = [sys.executable, "-m", "motord", "demo", "--out", folder, "--json", "--seed", "7"]
    done = subprocess.run([*command, *extent.options], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def test_ripple_before_and_after(demo: tuple[Path, dict], extent: Extent) -> None:
    _, found = demo
    assert len(found["points"]) == extent.points
    assert 5.0 < found["before"]["mean"] < 9.0
    # a tenth of this would be too good to be true at 1 kHz: sampled currents alone leave more
    assert 0.05 < found["after"]["max"] <= 0.5
    for point in found["points"]:
        assert point["before"] > 5.0
        assert 0.02 < point["after"] <= 0.5


def test_estimates_against_the_truth(demo: tuple[Path, dict]) -> None:
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


def test_files_can_be_used(demo: tuple[Path, dict], extent: Extent) -> None:
    folder, found = demo
    assert found["bench_s"] > extent.bench_s
    # of the calibration two more, with one phase's current scaled
    for name, more in (("verify-off.mcap", 0), ("calibrate.mcap", 2), ("verify-on.mcap", 0)):
        run = open_run(folder / name)
        assert run.check() is None
        assert len(run.operating_points()) == extent.points + more
    made = calibration.load(folder / "calibration.json")
    made.check_motor(load().motor)
    assert made.rms_error_percent.before is not None
    assert made.rms_error_percent.before.mean > 5.0
    report = (folder / "report.html").read_text()
    assert "<img" in report or "<svg" in report
    for outside in ("http://", "https://", 'src="/', "@import"):
        assert outside not in report.replace("http://www.w3.org", ""), outside
