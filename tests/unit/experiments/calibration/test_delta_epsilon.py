"""The common gain: measured by scaling one phase's current, else assumed and said so."""

import json
import re
from datetime import UTC, datetime
from pathlib import Path

import pytest

from motord.cli.analysis_command import app as analyse
from motord.cli.calibration.commands import app as calibration
from motord.config import load, packaged
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.plans import build
from motord.experiments.subject import Subject
from motord.recording.metadata import describe
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.rig.truth import load as load_truth
from motord.virtual import VirtualBench, run_plan
from tests.support.wrong_signals import CHANGES, change_recording
from tests.unit.experiments.test_cli import run

DELTA, EPSILON = 1.04, 0.975
MESH = {"torques_Nm": [2.0, 4.0], "speeds_Hz": [0.7, 1.0], "turns": 5, "settle_s": 0.5}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("gain") / "gain.mcap"
    config, truth = load(), load_truth()
    sensor = truth.torque_sensor.model_copy(update={"delta": DELTA})
    inverter = truth.inverter.model_copy(update={"epsilon": EPSILON})
    truth = truth.model_copy(update={"torque_sensor": sensor, "inverter": inverter})
    with RunWriter(path, describe(config, packaged("sim.toml").read_text())) as writer:
        for point in run_plan(
            VirtualBench(config, truth, seed=6),
            build("calibrate", config, MESH),
            lambda ticks, _: writer.ticks(ticks),
        ):
            writer.operating_point(int(point["t_end_ns"]), point)
    return path


def test_it_is_measured_and_the_file_names_the_run(recording: Path, tmp_path: Path) -> None:
    output = tmp_path / "c.json"
    code, out, _ = run(analyse, "calibrate", recording, "-o", output)
    assert code == 0
    assert "delta epsilon: measured" in " ".join(out.split())
    content = json.loads(output.read_text())
    assert content["delta_epsilon"] == pytest.approx(DELTA * EPSILON, rel=0.01)
    assert content["delta_epsilon_source"] == "gain.mcap"
    assert content["alpha"] == pytest.approx([0.8, 1.118, 1.118], rel=5e-3)
    assert content["tau_cog_harmonics"]
    assert all(0 < h["phase_stderr_rad"] < 3.2 for h in content["tau_cog_harmonics"])
    _, shown, _ = run(calibration, "show", output)
    interval = re.search(r"delta eps    ([\d.]+) \+- ([\d.]+) \(gain\.mcap\)", shown)
    assert interval is not None
    assert abs(float(interval[1]) - DELTA * EPSILON) < 2 * float(interval[2])


@pytest.mark.parametrize(
    ("change", "times"),
    [("torque * -1", "-1.01"), ("torque * 2", "2.03"), ("torque in kNm", "0.00")],
)
def test_a_scale_or_sign_that_is_wrong_is_measured_not_taken_for_noise(
    recording: Path, tmp_path: Path, change: str, times: str
) -> None:
    """Judged by what a common gain of 1 leaves of such a torque, no common gain is seen."""
    path = change_recording(recording, tmp_path / "changed.mcap", CHANGES[change])
    code, _, error = run(analyse, "calibrate", path)
    assert code == 1
    assert f"comes out {times} times as large as the back-EMF says" in " ".join(error.split())


def test_currents_as_rms_leave_the_gains_as_they_are(recording: Path, tmp_path: Path) -> None:
    path = change_recording(recording, tmp_path / "rms.mcap", CHANGES["currents as RMS"])
    runs = [open_run(path)]
    result = Calibrator.of_runs(runs, Subject.of_runs(runs)).result("joint")
    assert result.delta_epsilon == pytest.approx(2**0.5 * DELTA * EPSILON, rel=0.01)
    assert result.alpha == pytest.approx([0.8, 1.118, 1.118], rel=5e-3)
    assert [one.name for one in result.findings] == ["common-gain"]


def test_ripple_and_the_residual_estimator_are_of_the_mesh_alone(recording: Path) -> None:
    runs = [open_run(recording)]
    assert len(runs[0].operating_points()) == 6
    taken = Calibrator.of_runs(runs, Subject.of_runs(runs))
    joint, residual = taken.joint(), taken.residual()
    assert len(joint.ripples) == len(residual.ripples) == 4
    assert joint.delta_epsilon_stderr is not None
    assert 2e-4 < joint.delta_epsilon_stderr < 0.01
    assert residual.delta_epsilon == 1.0


def test_without_such_points_it_is_assumed(recorded) -> None:
    runs = [open_run(recorded.off)]
    subject = Subject.of_runs(runs)
    result = Calibrator.of_runs(runs, subject).joint()
    made = result.to_calibration(subject.motor, datetime.now(UTC), ["off.mcap"])
    assert (made.delta_epsilon, made.delta_epsilon_source) == (1.0, "assumed")
    assert "not seen" in made.observable[0]
