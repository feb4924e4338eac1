"""What is found of a profile that was played, against the truth of the simulated rig."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from motord.calibration import Calibration, load
from motord.config import packaged
from motord.experiments.plans import build
from motord.experiments.profile.command import ANALYSIS, estimate
from motord.experiments.profile.estimate import _asked_for, measure
from motord.experiments.profile.result import ProfileTracking
from motord.experiments.subject import AnalysisError, Recordings
from motord.recording.reader import bounds_of, open_run
from motord.results.figures import figures
from motord.schema import TICK_DTYPE
from motord.simulate import PlanSource, record_plan
from motord.verdict.figures import figures_of
from tests.support.virtual_calibration import calibrate_virtual
from tests.support.wrong_signals import CHANGES, change_recording
from tests.unit.experiments.profile.profiles import write

ROWS = ((0, 0, 0), (1, 0, 0), (3, 3, 0.9), (7, 3, 0.9), (9, 1.5, 0.6), (12, 1.5, 0.6), (14, 0, 0))


@dataclass(frozen=True)
class Played:
    """Recordings of a profile, without and with compensation, and the calibration."""

    off: Path
    on: Path
    calibration: Path


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Played:
    folder = tmp_path_factory.mktemp("played")
    source = PlanSource.of(None)
    files = Played(folder / "off.mcap", folder / "on.mcap", folder / "calibration.json")
    calibration = calibrate_virtual(source.config, 1, {"time_limit_s": 40.0})
    calibration.save(files.calibration)
    given = {"file": str(write(folder / "p.csv", ROWS))}
    for path, compensate in ((files.off, "off"), (files.on, "on")):
        plan = build("profile", source.config, {**given, "compensate": compensate})
        record_plan(source, plan, path, 4, calibration if compensate == "on" else None)
    return files


def found(path: Path, calibration: Path | None = None) -> ProfileTracking:
    return estimate(Recordings.open([path]), calibration)


def true_energy_J(path: Path) -> list[float]:
    run = open_run(path)
    truths = [run.truth(None, **bounds_of(point)) for point in run.operating_points()]
    return [
        float(np.trapezoid(t["torque_Nm"].astype(float) * t["speed_rad_s"], t["t_ns"] * 1e-9))
        for t in truths
    ]


def test_the_energy_is_that_of_the_rig_within_its_interval(played: Played) -> None:
    for path in (played.off, played.on):
        result = found(path, played.calibration)
        true_J = np.mean(true_energy_J(path))
        assert result.energy_J.low < true_J < result.energy_J.high
        assert result.energy_J.value == pytest.approx(true_J, rel=0.006)
        assert result.energy_J.high - result.energy_J.low < 0.05 * true_J
        assert result.power_mean_W.value == pytest.approx(true_J / 14, rel=0.01)
        true_turns = open_run(path).operating_points()[0]["turns"]
        assert result.cycles[0].turns == pytest.approx(true_turns, abs=0.01)


def test_a_compensated_bench_follows_and_another_ripples(played: Played) -> None:
    off, on = found(played.off, played.calibration), found(played.on, played.calibration)
    assert 0.003 < on.speed_rms_Hz.value < 0.015 < 0.06 < off.speed_rms_Hz.value < 0.12
    assert 0.02 < on.torque_rms_Nm.value < 0.12 < 0.3 < off.torque_rms_Nm.value < 0.5
    assert on.speed_within_percent == 100.0
    assert [finding.name for finding in on.findings] == []
    assert [finding.name for finding in off.findings] == [
        "speed-off-the-profile", "torque-off-the-profile",
    ]  # fmt: skip
    speed = off.cycles[0].speed
    assert speed.rms < speed.max == pytest.approx(off.speed_max_Hz, rel=0.2)
    assert 0 <= speed.max_at_s <= 14


def test_tolerances_are_those_of_the_plan(played: Played, tmp_path: Path) -> None:
    source = PlanSource.of(None)
    given = {"file": str(write(tmp_path / "p.csv", ROWS)), "repeats": 1}
    shares = []
    for tolerances in ({}, {"speed_tolerance_Hz": 0.01, "torque_tolerance_Nm": 0.05}):
        path = tmp_path / f"{len(shares)}.mcap"
        record_plan(source, build("profile", source.config, {**given, **tolerances}), path, 4)
        shares.append(found(path))
    wide, narrow = shares
    assert narrow.speed_within_percent < 0.5 * wide.speed_within_percent
    assert narrow.torque_within_percent < 0.5 * wide.torque_within_percent
    assert narrow.speed_rms_Hz.value == wide.speed_rms_Hz.value
    assert wide.speed_rms_Hz.high is None
    assert any(note.startswith("one cycle shows no scatter") for note in wide.notes)


def test_without_a_calibration_the_energy_has_no_interval(played: Played) -> None:
    result = found(played.off)
    assert result.energy_J.value == pytest.approx(np.mean(true_energy_J(played.off)), rel=0.03)
    assert result.energy_J.low is None
    assert "name the calibration with --calibration" in result.notes[0]


def test_a_sensor_that_passes_the_mean_needs_no_currents(played: Played) -> None:
    recordings = Recordings.open([played.on])
    subject = recordings.subject
    passes = replace(
        subject, sensor=subject.sensor.model_copy(update={"highpass_time_constant_s": 0.0})
    )
    recordings.__dict__["subject"] = passes
    result = measure(recordings, None)
    relative = 1.96 * subject.accuracy.torque_gain_percent / 100 / np.sqrt(3)
    half_J = result.energy_J.high - result.energy_J.value
    assert half_J >= relative * abs(result.energy_J.value)
    assert result.notes[0] == "torque: as the sensor measures it"


def test_the_zero_of_a_sensor_that_passes_the_mean_is_in_the_intervals(
    played: Played, tmp_path: Path
) -> None:
    """A zero at its limit of 50 mNm, which is alike in all cycles: their scatter shows nothing."""

    def off(ticks: np.ndarray) -> np.ndarray:
        ticks["torque_Nm"] += 0.05
        return ticks

    results = []
    for path in (played.on, change_recording(played.on, tmp_path / "off.mcap", off)):
        recordings = Recordings.open([path])
        subject = recordings.subject
        recordings.__dict__["subject"] = replace(
            subject,
            sensor=subject.sensor.model_copy(update={"highpass_time_constant_s": 0.0}),
            accuracy=subject.accuracy.model_copy(update={"torque_zero_Nm": 0.05}),
        )
        results.append(measure(recordings, None))
    true, found = results
    [turned] = {
        round(2 * np.pi * np.mean([one.turns for one in each.cycles]), 6) for each in results
    }
    for figure, error in (("torque_mean_Nm", 0.05), ("energy_J", 0.05 * turned)):
        value, mean = getattr(true, figure).value, getattr(found, figure)
        assert mean.value - value == pytest.approx(error, rel=0.01), figure
        assert mean.low < value < mean.high, figure
        alone = getattr(replace(found, torque_zero_Nm=0.0), figure)
        half = np.hypot(alone.value - alone.low, 1.96 * error / np.sqrt(3))
        assert mean.value - mean.low == pytest.approx(half, rel=1e-3), figure


def test_what_was_asked_for_is_taken_from_the_middle_of_each_set_point() -> None:
    ticks = np.zeros(1000, TICK_DTYPE)
    t_s = np.arange(1000) * 1e-3
    ticks["setpoint_seq"] = np.arange(1000) // 50
    middle_s = (ticks["setpoint_seq"] * 50 + 24.5) * 1e-3
    ticks["speed_set_rad_s"] = 3 * middle_s
    ramp = np.minimum((np.arange(1000) % 50 + 1) * 0.01, 0.05 * 2)
    ticks["torque_set_Nm"] = 2 * (middle_s - 0.05) + ramp
    speed_rad_s, torque_Nm = _asked_for(t_s, ticks)
    inside = slice(30, 970)
    assert np.allclose(speed_rad_s[inside], 3 * t_s[inside], atol=1e-4)
    assert np.allclose(torque_Nm[inside], 2 * t_s[inside], atol=1e-4)


def test_json_page_and_text(played: Played) -> None:
    recordings = Recordings.open([played.on])
    result = estimate(recordings, played.calibration)
    content = json.loads(json.dumps(ANALYSIS.to_json(result, recordings)))
    assert content["schema"] == "motord.profile/1"
    assert content["energy_low_J"] < content["energy_J"] < content["energy_high_J"]
    assert [cycle["cycle"] for cycle in content["cycles"]] == [1, 2, 3]
    assert len(content["sha256"]) == 64
    kept = {figure.field: figure for figure in figures(content)}
    assert kept["energy_J"].unit == "J"
    assert kept["energy_J"].low == content["energy_low_J"]
    page = ANALYSIS.page(result, recordings).html()
    for part in ("Torque and speed over time", "SHA-256", content["sha256"], "mechanical energy"):
        assert part in page
    assert any("torque: as the sensor" in str(line) for line in ANALYSIS.lines(result, recordings))


def test_limits_can_be_set_for_its_figures(played: Played) -> None:
    from motord.config.experiments import analysis_kinds

    recordings = Recordings.open([played.off])
    content = ANALYSIS.to_json(estimate(recordings, played.calibration), recordings)
    for kind in analysis_kinds()["profile"].figures:
        [figure] = figures_of(kind, content, {})
        assert figure.value is not None


def test_recordings_of_other_profiles_or_plans_are_refused(played: Played, tmp_path: Path) -> None:
    source = PlanSource.of(None)
    given = {"file": str(write(tmp_path / "q.csv", ROWS[:4])), "repeats": 1}
    record_plan(source, build("profile", source.config, given), tmp_path / "q.mcap", 4)
    with pytest.raises(AnalysisError, match="another profile"):
        measure(Recordings.open([played.off, tmp_path / "q.mcap"]), None)
    with pytest.raises(AnalysisError, match=r"is of the plan|names no plan"):
        measure(Recordings.open([_friction(tmp_path)]), None)


def _friction(folder: Path) -> Path:
    source = PlanSource.of(None)
    plan = build("friction", source.config, {"repeats": 1})
    record_plan(source, plan, folder / "f.mcap", 1)
    return folder / "f.mcap"


def test_the_recording_says_which_file_was_played(played: Played) -> None:
    plan = open_run(played.off).metadata["plan"]
    assert plan["settings"]["file"].endswith("p.csv")
    assert len(plan["settings"]["sha256"]) == 64
    assert packaged("examples/profiles/short-cycle.csv").exists()
    assert isinstance(load(played.calibration), Calibration)


@pytest.mark.parametrize(
    ("change", "findings"),
    [
        ("torque * 2", {"torque-scale"}),
        ("currents as RMS", {"current-scale"}),
        ("currents of b and c swapped", {"current-scale", "torque-of-currents"}),
        ("encoder backwards", {"torque-of-currents"}),
        ("encoder misread at times", {"encoder-misread"}),
        ("torque * 1.1", set()),
        ("a tenth of the ticks lost", set()),
    ],
)
def test_wrong_signals_are_serious_findings(
    played: Played, tmp_path: Path, change: str, findings: set[str]
) -> None:
    path = change_recording(played.on, tmp_path / "changed.mcap", CHANGES[change])
    result = found(path, played.calibration)
    assert {one.name for one in result.findings if one.severity == "serious"} == findings
