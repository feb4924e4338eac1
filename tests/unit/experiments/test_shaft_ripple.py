"""Every analysis that states the ripple of an operating point states the same."""

import pytest

from motord.config import load
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.captures_left_out import EveryCapture
from motord.experiments.ripple.estimate import ripples
from motord.experiments.sensitivity.estimate import measured_ripples
from motord.experiments.soak.point_ripples import point_ripples
from motord.experiments.subject import Subject
from motord.recording.reader import Run, open_run
from tests.unit.experiments.conftest import Recorded


def test_images_of_held_currents_are_where_they_are_in_all_analyses(
    recorded: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, subject = open_run(recorded.off), Subject.of_config(load())
    verified = [one.rms_percent for one in ripples([run], subject, EveryCapture())]
    sensitivity = [one.rms_percent for one, *_ in measured_ripples([run], subject, EveryCapture())]
    before = [one.rms_percent for one in Calibrator.of_runs([run], subject).joint().ripples]
    monkeypatch.setattr(Run, "plan_metadata", {"settings": {"inner": {"turns": 5}}})
    found = point_ripples(run, run.operating_points(), subject).values()
    assert sensitivity == verified
    assert before == pytest.approx(verified, rel=1e-3)  # with lines that are not looked for there
    assert [getattr(one, "rms_percent", None) for one in found] == pytest.approx(verified, rel=1e-9)
    run.metadata["config"] = run.metadata["config"].replace("lag_s", "# lag_s")
    sampled = [one.rms_percent for one in ripples([run], subject, EveryCapture())]
    assert min(abs(one / other - 1) for one, other in zip(verified, sampled, strict=True)) > 2e-3
