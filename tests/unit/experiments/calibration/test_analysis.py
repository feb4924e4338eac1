from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from motord.calibration import load as load_calibration
from motord.config import load, packaged
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.comparison import CalibratedRuns, recorded_truth
from motord.experiments.calibration.report import report
from motord.experiments.captures_left_out import EveryCapture
from motord.experiments.ripple import report as ripple
from motord.experiments.ripple.estimate import MeshRipple, ripples
from motord.experiments.subject import AnalysisError, Recordings, Subject
from motord.recording.reader import open_run
from tests.unit.experiments.conftest import Recorded

ALPHA = np.array([0.8, 1.118, 1.118])


def test_runs_say_what_they_are_of(recorded: Recorded) -> None:
    runs = [open_run(recorded.off), open_run(recorded.on)]
    assert Subject.of_runs(runs) == Subject.of_config(load())


def test_subject_of_bench_and_motor_files(tmp_path: Path) -> None:
    assert Subject.of_file(packaged("sim.toml")) == Subject.of_config(load())
    text = packaged("sim.toml").read_text()
    motor = text[text.index("[motor]") : text.index("[limits]")]
    (tmp_path / "m.toml").write_text(motor)
    subject = Subject.of_file(tmp_path / "m.toml")
    assert subject.motor == load().motor
    assert subject.bench == "m"
    assert subject.sensor.resonance_Hz == 0


def test_runs_of_different_motors_are_not_mixed(recorded: Recorded) -> None:
    one, other = open_run(recorded.off), open_run(recorded.on)
    other.metadata = {**other.metadata, "motor": {**other.metadata["motor"], "serial": "other"}}
    with pytest.raises(AnalysisError, match=r"on\.mcap: is of another motor"):
        Subject.of_runs([one, other])
    other.metadata["motor"]["serial"] = ""
    assert Subject.of_runs([other, one]).motor == Subject.of_runs([one]).motor
    other.metadata = {"bench": "x"}
    with pytest.raises(AnalysisError, match=r"on\.mcap: does not say which motor.*with -c"):
        Subject.of_runs([one, other])


@pytest.mark.parametrize(("in_file", "expected"), [("", "47/1"), ("of the file", "of the file")])
def test_the_serial_number_is_recorded_unless_the_file_names_one(
    in_file: str, expected: str, recorded: Recorded, tmp_path: Path
) -> None:
    text = packaged("sim.toml").read_text()
    motor = text[text.index("[motor]") : text.index("[limits]")]
    (tmp_path / "m.toml").write_text(motor.replace('"sim-1"', f'"{in_file}"'))
    run = open_run(recorded.off)
    run.metadata = {**run.metadata, "motor": {**run.metadata["motor"], "serial": "47/1"}}
    assert Recordings((run,), tmp_path / "m.toml").subject.motor.serial == expected


def test_the_truth_is_in_the_recording(recorded: Recorded) -> None:
    run = open_run(recorded.off)
    truth = recorded_truth([run], Subject.of_config(load()))
    assert truth is not None
    assert np.abs(truth.alpha / ALPHA - 1).max() < 1e-3
    assert np.abs(truth.beta_A - [1.0, -0.5, -0.5]).max() < 5e-3
    assert [h.order for h in truth.harmonics] == [16, 32, 48, 96]
    amplitudes_Nm = [h.amplitude_Nm for h in truth.harmonics]
    assert np.allclose(amplitudes_Nm, [0.08, 0.04, 0.33, 0.06], atol=1e-4)


def test_a_real_run_has_no_truth(recorded: Recorded) -> None:
    class Bare:
        truth_table = type("Table", (), {"present": False})()

    assert recorded_truth([Bare()], Subject.of_config(load())) is None


@pytest.mark.usefixtures("no_pictures")
def test_from_runs_to_a_page(recorded: Recorded) -> None:
    recordings = Recordings.open([recorded.off, recorded.on])
    subject = recordings.subject
    calibrator = Calibrator.of_runs(recordings.runs[:1], subject)
    joint, other = calibrator.joint(), load_calibration(recorded.calibration)
    assert np.abs(joint.alpha / ALPHA - 1).max() < 5e-3
    both = replace(joint, ripples=tuple(ripples(recordings.runs, subject, EveryCapture())))
    before, after = ripple.before_and_after(both.ripples)
    assert set(before) == set(after) == {(t, s) for t in (2.0, 4.0) for s in (0.8, 1.0)}
    assert min(before.values()) > 5
    assert max(after.values()) < 0.5
    made = joint.to_calibration(subject.motor, datetime.now(UTC), recordings.names)
    text = report(CalibratedRuns(calibrator, both, made, other), recordings).html()
    seen = (
        "off.mcap, on.mcap", made.id, "48 slots, 16 poles", f"calibration {other.id}",
        "residual estimator", "Torque at 4 Nm, 0.8 turns/s",
        "standard error at the bound", "variance of the predicted ripple",
    )  # fmt: skip
    for part in seen:
        assert part in text


def test_the_progress_is_that_of_all_recordings_together(recorded: Recorded) -> None:
    seen: list[tuple[str, float]] = []
    recordings = Recordings.open([recorded.off, recorded.on])
    Calibrator.of_runs(recordings.runs, recordings.subject, lambda *step: seen.append(step))
    assert seen == [("reading", number / 8) for number in range(1, 9)]


@pytest.mark.usefixtures("no_pictures")
def test_a_page_without_points(recorded: Recorded) -> None:
    text = ripple.report(MeshRipple(()), Recordings.open([recorded.off])).html()
    assert "Torque at" not in text
    assert "off.mcap" in text


@pytest.mark.usefixtures("no_pictures")
def test_a_point_with_one_side_only(recorded: Recorded) -> None:
    recordings = Recordings.open([recorded.on])
    points = ripples(recordings.runs, recordings.subject, EveryCapture())
    assert "Torque at 4 Nm" in ripple.report(MeshRipple(tuple(points)), recordings).html()
    uneven = (*points, replace(points[0], torque_Nm=9.0, compensate=0))
    assert "Torque at" in ripple.report(MeshRipple(uneven), recordings).html()
