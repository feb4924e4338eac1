"""A small `sensitivity` plan on the simulated bench, analysed from its recording."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from motord.calibration import load
from motord.cli.analysis_command import app as analyse
from motord.config import load as load_bench
from motord.config import packaged
from motord.experiments.plans import build
from motord.experiments.sensitivity import command, estimate
from motord.experiments.sensitivity.estimate import sensitivity, theory_alone
from motord.experiments.sensitivity.result import Sensitivity
from motord.experiments.subject import AnalysisError, Subject
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData
from motord.recording.metadata import describe
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.virtual import VirtualBench, run_plan
from tests.support.wrong_signals import CHANGES, change_recording
from tests.unit.experiments.conftest import Recorded
from tests.unit.experiments.test_cli import run

SETTINGS = {
    "turns": 4, "settle_s": 0.5, "alpha_a_steps": 5, "beta_a_steps": 5, "cogging_steps": 5,
    "delta_epsilon_steps": 3, "again_torques_Nm": [1.5, 4.5], "again_speeds_Hz": [0.6, 0.9],
}  # fmt: skip


@pytest.fixture(scope="module")
def recording(recorded: Recorded, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sensitivity") / "sensitivity.mcap"
    config = load_bench()
    bench = VirtualBench(config, seed=8, calibration=load(recorded.calibration))
    with RunWriter(path, describe(config, packaged("sim.toml").read_text())) as writer:
        for point in run_plan(
            bench,
            build("sensitivity", config, SETTINGS),
            lambda ticks, truth: writer.ticks(ticks),
        ):
            writer.operating_point(int(point["t_end_ns"]), point)
    return path


@pytest.fixture(scope="module")
def two_series(recording: Path) -> Path:
    """Only the points of no error and of the first two kinds."""
    run, path = open_run(recording), recording.with_name("two-series.mcap")
    ticks, points = run.ticks(), run.operating_points()[:9]
    with RunWriter(path, run.metadata) as writer:
        writer.ticks(ticks[ticks["plan_point"] < len(points)])
        for point in points:
            writer.operating_point(int(point["t_ns"]), point)
    return path


@pytest.fixture(scope="module")
def analysed(recording: Path) -> tuple[Sensitivity, str]:
    """Return what the command finds, with what it prints; its files are next to the recording."""
    found: list[Sensitivity] = []

    def kept(*arguments: Any) -> Sensitivity:
        found.append(sensitivity(*arguments))
        return found[0]

    files = ("-o", recording.with_suffix(".json"), "--report", recording.with_suffix(".html"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "sensitivity", kept)
        code, out, err = run(analyse, "sensitivity", recording, *files)
    assert code == 0, err
    return found[0], out


@pytest.fixture(scope="module")
def result(analysed: tuple[Sensitivity, str]) -> Sensitivity:
    return analysed[0]


def test_practice_agrees_with_theory(result: Sensitivity) -> None:
    assert [one.what for one in result.series] == [
        "alpha_a", "beta_a_A", "cogging", "delta_epsilon",
    ]  # fmt: skip
    for one in result.series:
        assert one.worst_difference_percent < 0.2, one.what
    for one in result.series[:2]:
        for branch in one.branches:
            assert branch is not None
            assert branch.slope == pytest.approx(branch.theory_slope, rel=0.05)
    assert 0.05 < result.series[0].floor_percent < 0.4


@pytest.mark.usefixtures("no_search_for_lines")
def test_currents_of_another_scale_are_a_finding(
    two_series: Path, result: Sensitivity, tmp_path: Path
) -> None:
    path = change_recording(two_series, tmp_path / "rms.mcap", CHANGES["currents as RMS"])
    runs = [open_run(path)]
    [finding] = sensitivity(runs, Subject.of_runs(runs)).signal_findings
    assert (finding.name, finding.severity) == ("current-scale", "serious")
    assert finding.value == pytest.approx(100 / 2**0.5 - 100, abs=1.0)
    assert result.signal_findings == ()


def test_mains_hum_is_a_finding_and_in_the_errors(
    two_series: Path, result: Sensitivity, tmp_path: Path
) -> None:
    """2 % of rated at 50 Hz: what the average over turns keeps of it is in all points."""

    def hum(ticks: np.ndarray) -> np.ndarray:
        ticks["torque_Nm"] += 0.12 * np.sin(2 * np.pi * 50e-9 * ticks["t_ns"])
        return ticks

    runs = [open_run(change_recording(two_series, tmp_path / "hum.mcap", hum))]
    humming = sensitivity(runs, Subject.of_runs(runs))
    [finding] = humming.signal_findings
    assert finding.name == "asynchronous-line"
    assert finding.value == pytest.approx(2.0, rel=0.3)
    gain = result.subject.accuracy.torque_gain_percent / 100 / 3**0.5
    for one, other in zip(result.series[:2], humming.series, strict=True):
        off = np.abs(other.measured_percent - one.measured_percent)
        assert (off < 1.96 * np.hypot(one.stderr_percent, other.stderr_percent)).all()
        assert (one.stderr_percent > gain * one.measured_percent).all()


def test_errors_that_were_induced_are_found_again(result: Sensitivity) -> None:
    again = result.again
    assert again is not None
    assert again.alpha == pytest.approx([0.8, 1.118, 1.118], abs=1e-4)
    assert again.found.alpha == pytest.approx(again.alpha, rel=5e-3)
    assert again.found.beta_A == pytest.approx(again.beta_A, abs=0.05)  # of 10 turns in all
    errors = np.abs(again.found.beta_A - again.beta_A) / again.found.beta_stderr_A
    assert (errors < 3.5).all()
    assert (again.cost_percent < 0.2).all()


def test_the_theory_is_of_the_cogging_torque_that_was_compensated(
    result: Sensitivity, recorded: Recorded
) -> None:
    table = np.array(load(recorded.calibration).tau_cog_Nm)
    alone = theory_alone(result.subject, table, 3.0)
    for what, within in alone.theory.within.items():
        assert result.theory.within[what] == pytest.approx(within, rel=2e-3), what


def test_from_the_command_line(recording: Path, analysed: tuple[Sensitivity, str]) -> None:
    _, out = analysed
    assert "induced, and calibrated again" in " ".join(out.split())
    content = json.loads(recording.with_suffix(".json").read_text())
    assert content["schema"] == "motord.sensitivity/1"
    assert content["torque_Nm"] == 3.0
    assert content["series"][0]["what"] == "alpha_a"
    text = recording.with_suffix(".html").read_text()
    for figure in ("Figure 4.3", "Figure 4.4", "Figures 4.6 to 4.9", "Table 4.2", "24.1 %"):
        assert figure in text
    assert text.count("<figure>") == 4


@pytest.mark.usefixtures("no_pictures")
def test_theory_alone_from_the_command_line(recorded: Recorded, tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(packaged("sim.toml").read_text().replace('rig = "report.rig.toml"\n', ""))
    arguments = ("sensitivity", "-c", bench, "--calibration", recorded.calibration, "--json")
    page = tmp_path / "theory.html"
    code, out, _ = run(analyse, *arguments, "--torque", 2, "--report", page)
    content = json.loads(out)
    assert code == 0
    assert content["torque_Nm"] == 2.0
    assert content["series"] == []
    assert content["again"] is None
    low, high = content["theory"]["within"]["alpha_a"]
    assert 0.8 < low < 0.94 < 1.06 < high < 1.2
    assert page.read_text().count("<figure>") == 2
    assert "which alone leaves at most 1 % by theory</span>" in page.read_text()


def test_what_has_no_induced_errors_is_refused(recorded: Recorded) -> None:
    runs = [open_run(recorded.on)]
    with pytest.raises(AnalysisError, match="record the plan `sensitivity`"):
        sensitivity(runs, Subject.of_runs(runs))
    runs = [open_run(recorded.off)]
    with pytest.raises(IdentifyError, match="install a calibration"):
        sensitivity(runs, Subject.of_runs(runs))


def test_options_that_contradict_are_refused(recorded: Recorded) -> None:
    code, _, err = run(analyse, "sensitivity")
    assert (code, "--calibration" in err) == (1, True)
    code, _, err = run(analyse, "sensitivity", recorded.on, "--torque", 2)
    assert (code, "leave out" in err) == (1, True)


def test_points_to_calibrate_from_again_show_no_single_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With gains alone they were on the line of the gain, of which they have other torques."""
    single, again = (0.8, 0.8**-0.5, 0.8**-0.5), (0.8, 1.118, 1.118)
    points = [
        PointData(torque_Nm, 0.7, np.empty(0), induced={"gain": list(gain)})
        for torque_Nm, gain in ((3.0, single), (1.0, again), (5.0, again))
    ]
    monkeypatch.setattr(estimate, "captures", lambda *_: iter(points))
    settings = {"again_alpha": list(again), "again_beta_A": [0.0, 0.0, 0.0]}
    run = SimpleNamespace(plan_metadata={"settings": settings})
    kinds = [one for *_, one in estimate._points([cast("Any", run)])]
    assert kinds == [{"alpha_a": 0.8}, {}, {}]


def test_single_errors_at_several_speeds_are_refused(
    two_series: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(two_series)
    first, *others = run.operating_points()
    monkeypatch.setattr(run, "operating_points", lambda: [{**first, "speed_Hz": 0.9}, *others])
    with pytest.raises(AnalysisError, match="analyse the recordings one by one"):
        sensitivity([run], Subject.of_runs([run]))
