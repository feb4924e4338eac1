from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from motord.calibration import load as load_calibration
from motord.config import load, packaged
from motord.experiments.calibration import content as page_content
from motord.experiments.calibration import recordings
from motord.experiments.calibration.report import page
from motord.experiments.calibration.truth import recorded_truth
from motord.experiments.subject import AnalysisError, Subject
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
    other.metadata = {"bench": "x"}
    with pytest.raises(AnalysisError, match=r"on\.mcap: does not say which motor.*with -c"):
        Subject.of_runs([one, other])


def test_the_truth_is_in_the_recording(recorded: Recorded) -> None:
    run = open_run(recorded.off)
    truth = recorded_truth([run], Subject.of_config(load()))
    assert truth is not None
    assert np.abs(truth.alpha / ALPHA - 1).max() < 1e-3
    assert np.abs(truth.beta_A - [1.0, -0.5, -0.5]).max() < 5e-3
    assert truth.order.tolist() == [16, 32, 48, 96]
    assert np.allclose(truth.amplitude_Nm, [0.08, 0.04, 0.33, 0.06], atol=1e-4)


def test_a_real_run_has_no_truth(recorded: Recorded) -> None:
    class Bare:
        truth_table = type("Table", (), {"present": False})()

    assert recorded_truth([Bare()], Subject.of_config(load())) is None  # type: ignore[list-item]


def test_from_runs_to_a_page(recorded: Recorded) -> None:
    runs = [open_run(recorded.off), open_run(recorded.on)]
    subject = Subject.of_runs(runs)
    calibrator = recordings.calibrator(runs[:1], subject)
    joint, residual = calibrator.joint(), calibrator.residual()
    assert np.abs(joint.alpha / ALPHA - 1).max() < 5e-3
    points = recordings.ripples(runs, subject)
    calibration = load_calibration(recorded.calibration)
    content = page_content.calibration_report(
        subject,
        [run.path.name for run in runs],
        calibration,
        points,
        [page_content.estimate_of_result(r, r.method) for r in (joint, residual)],
        page_content.estimate_of_calibration(calibration, "last calibration"),
    )
    assert (
        set(content.before)
        == set(content.after)
        == {(t, s) for t in (2.0, 4.0) for s in (0.8, 1.0)}
    )
    assert min(content.before.values()) > 5
    assert max(content.after.values()) < 0.5
    assert content.view is not None
    assert content.view.label == "4 Nm, 0.8 turns/s"
    text = page(content).html()
    for words in ("off.mcap, on.mcap", calibration.id, "48 slots, 16 poles", "last calibration"):
        assert words in text


def test_a_page_without_points_or_calibration() -> None:
    subject = Subject.of_config(load())
    content = page_content.calibration_report(subject, ["x.mcap"], None, [])
    assert content.view is None
    assert "x.mcap" in page(content).html()


def test_a_view_of_one_side_only(recorded: Recorded) -> None:
    subject = Subject.of_config(load())
    points = recordings.ripples([open_run(recorded.on)], subject)
    content = page_content.calibration_report(subject, [], None, points)
    assert content.view is not None
    assert content.view.before is None
    assert content.view.after is not None
    uneven = [*points, replace(points[0], torque_Nm=9.0, compensate=0)]
    assert page_content.calibration_report(subject, [], None, uneven).view is not None
