"""Learning from recordings: two passes, what is refused, the command, the page."""

import json
import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from motord.calibration import Calibration, load
from motord.cli.analysis_command import app
from motord.config.devices import InverterConfig
from motord.experiments.hold_timing import recorded_hold, zero_order_hold
from motord.experiments.ilc.analysis import (
    LearnPass,
    finish,
    learn_from_runs,
    reopen,
)
from motord.experiments.ilc.estimate import Learning
from motord.experiments.ilc.order_list import SeenRipple
from motord.experiments.ilc.report import report
from motord.experiments.subject import AnalysisError, Subject
from motord.identification.operating_points import CURRENTS
from motord.recording.captures import true_torque
from motord.recording.reader import Run, open_run
from motord.recording.writer import RunWriter
from tests.support.wrong_signals import CHANGES, change_recording
from tests.unit.experiments.ilc.learning import nonlinear, record_pass, true_calibration
from tests.unit.experiments.test_cli import run as invoke

NOW = datetime(2026, 5, 1, tzinfo=UTC)


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Calibration]:
    path, calibration = tmp_path_factory.mktemp("learn") / "one.mcap", true_calibration()
    record_pass(path, calibration, seed=3)
    return path, calibration


def learned_from(path: Path, calibration: Calibration) -> LearnPass:
    subject = Subject.of_config(nonlinear())
    return learn_from_runs([open_run(path)], subject, calibration, NOW, Learning())


@pytest.fixture(scope="module")
def once(first: tuple[Path, Calibration]) -> LearnPass:
    """Return what is learned from the first pass."""
    return learned_from(*first)


def true_percent(run: Run) -> list[float]:
    return [
        float(100 / 6.0 * np.sqrt(np.cov(t.torque_Nm, aweights=t.weights)))
        for t in true_torque(run)
    ]


def test_two_passes_smooth_the_true_torque(
    first: tuple[Path, Calibration], once: LearnPass, tmp_path: Path
) -> None:
    assert not once.finished
    assert once.calibration.learned is not None
    assert list(once.learned.by_place) == [(3.0, 0.8), (3.0, 1.0)]
    assert once.calibration.learned.orders[:2] == (8, 16)
    record_pass(tmp_path / "two.mcap", once.calibration, seed=4)
    before, after = true_percent(open_run(first[0])), true_percent(open_run(tmp_path / "two.mcap"))
    assert min(before) > 0.8
    assert max(np.divide(after, before)) < 0.5
    twice = learned_from(tmp_path / "two.mcap", once.calibration)
    history = twice.learned.points[0].history_percent
    assert len(history) == 2
    assert history[1] < 0.5 * history[0]
    assert twice.calibration.learned is not None
    assert twice.calibration.learned.runs == ("one.mcap", "two.mcap")
    done = finish(twice, NOW)
    assert done.finished
    assert done.learned.points[0].cos_Nm == once.learned.points[0].cos_Nm
    assert finish(done, NOW).calibration is done.calibration
    again = reopen(done.calibration, NOW, Learning())
    assert again.learned is not None
    assert again.learned.points[0].gain == Learning().gain


def test_a_point_that_no_pass_could_use_has_neither_errors_nor_intervals(once: LearnPass) -> None:
    unused = once.learned.points[0].model_copy(update={"history_percent": ()})
    points = unused, *once.learned.points[1:]
    learned = once.learned.model_copy(update={"points": points})
    done = replace(once, calibration=once.calibration.with_learned(learned, NOW))
    counts = [
        (len(point["rms_percent"]), len(point["rms_half_width_percent"]))
        for point in done.to_json()["points"]
    ]
    assert counts == [(0, 0), (1, 1)]


def test_corrections_at_their_limit_are_a_finding(once: LearnPass) -> None:
    most_Nm = max(point.amplitude_Nm for point in once.learned.points)
    for limit_Nm, names in ((2 * most_Nm, []), (most_Nm, ["correction-limited"])):
        found = replace(once, limit_Nm=limit_Nm).findings
        assert [one.name for one in found] == names


def test_mains_hum_is_a_finding_and_is_not_learned(
    first: tuple[Path, Calibration], once: LearnPass, tmp_path: Path
) -> None:
    """1 % of rated at 50 Hz: what the average over turns keeps of it looks like ripple."""

    def hum(ticks: np.ndarray) -> np.ndarray:
        ticks["torque_Nm"] += 0.06 * np.sin(2 * np.pi * 50.07e-9 * ticks["t_ns"])
        return ticks

    path = change_recording(first[0], tmp_path / "hum.mcap", hum)
    humming = learned_from(path, first[1])
    assert once.findings == ()
    [found] = humming.findings
    assert (found.name, found.severity) == ("asynchronous-line", "warning")
    assert found.value == pytest.approx(1.0, rel=0.2)
    assert "which is not learned" in found.meaning
    orders = sorted({*once.learned.orders, *humming.learned.orders})
    for one, other in zip(once.learned.points, humming.learned.points, strict=True):
        lines_Nm = [
            dict(zip(done.learned.orders, point.line_Nm, strict=True))
            for done, point in ((once, one), (humming, other))
        ]
        changed_Nm = [lines_Nm[0].get(order, 0) - lines_Nm[1].get(order, 0) for order in orders]
        assert np.linalg.norm(changed_Nm) / 2**0.5 < 1e-2  # 27 mNm if all were learned


def test_nothing_is_learned_from_an_encoder_that_is_misread(
    first: tuple[Path, Calibration], tmp_path: Path
) -> None:
    path = change_recording(first[0], tmp_path / "run.mcap", CHANGES["encoder misread at times"])
    with pytest.raises(
        AnalysisError, match=r"left out: run\.mcap: 3 Nm, 0\.8 Hz: encoder_count jumps"
    ):
        learned_from(path, first[1])


def test_a_count_out_of_range_does_not_end_learning(
    first: tuple[Path, Calibration], tmp_path: Path
) -> None:
    change = CHANGES["encoder out of range at times"]
    found = learned_from(change_recording(first[0], tmp_path / "run.mcap", change), first[1])
    assert "encoder-out-of-range" in {one.name for one in found.findings}


def test_a_run_with_another_calibration_is_refused(first: tuple[Path, Calibration]) -> None:
    path, calibration = first
    other = calibration.model_copy(update={"id": "f" * 16})
    with pytest.raises(AnalysisError, match=f"was taken with calibration {calibration.id}"):
        learned_from(path, other)


def test_a_point_of_two_recordings_of_a_pass_is_refused(first: tuple[Path, Calibration]) -> None:
    """It was settled without a correction: the second counted for the correction of the first."""
    path, calibration = first
    subject, runs = Subject.of_config(nonlinear()), [open_run(path)] * 2
    with pytest.raises(AnalysisError, match=r"3 Nm, 0\.8 Hz was taken twice"):
        learn_from_runs(runs, subject, calibration, NOW, Learning())


def test_a_run_without_what_was_learned_is_refused(
    first: tuple[Path, Calibration], tmp_path: Path
) -> None:
    calibration = first[1]
    record_pass(tmp_path / "v.mcap", calibration, 1, "verify", compensate="calibration", turns=2)
    with pytest.raises(AnalysisError, match="not taken with everything applied"):
        learned_from(tmp_path / "v.mcap", calibration)


def test_another_mesh_than_that_which_was_learned_is_refused(
    once: LearnPass, tmp_path: Path
) -> None:
    record_pass(tmp_path / "m.mcap", once.calibration, 1, speeds_Hz=[0.9])
    with pytest.raises(AnalysisError, match=r"3 Nm, 0\.9 Hz is not a point of the mesh"):
        learned_from(tmp_path / "m.mcap", once.calibration)


def test_a_run_without_points_is_refused(first: tuple[Path, Calibration], tmp_path: Path) -> None:
    metadata = {**open_run(first[0]).metadata}
    with RunWriter(tmp_path / "empty.mcap", metadata):
        pass
    with pytest.raises(AnalysisError, match="nothing is learned: no operating point"):
        learned_from(tmp_path / "empty.mcap", first[1])
    with RunWriter(tmp_path / "untold.mcap", {**metadata, "config": ""}):
        pass
    assert recorded_hold(open_run(tmp_path / "untold.mcap")) is None
    with RunWriter(tmp_path / "no-delay.mcap", {**metadata, "config": "[inverter]\n"}):
        pass
    unknown = recorded_hold(open_run(tmp_path / "no-delay.mcap"))
    assert unknown is not None
    assert np.isnan(unknown.dead_s)
    assert unknown.period_s == 1e-3
    older = "[inverter]\n[loop]\nrate_Hz = 500\nring_s = 1.0\n"  # by bounds of before
    with RunWriter(tmp_path / "older.mcap", {**metadata, "config": older}):
        pass
    hold = recorded_hold(open_run(tmp_path / "older.mcap"))
    assert hold is not None
    assert hold.period_s == 2e-3


def test_timing_of_the_currents_is_read_from_the_bench_file(
    first: tuple[Path, Calibration],
) -> None:
    hold = recorded_hold(open_run(first[0]))
    assert hold is not None
    assert (hold.dead_s, hold.lag_s, hold.period_s) == pytest.approx((0.2e-3, 0.2e-3, 1e-3))
    late = zero_order_hold(InverterConfig(actuation_delay_s=0.5e-3, lag_s=0.1e-3), 1e-3)
    assert (late.dead_s, late.lag_s) == pytest.approx((0.4e-3, 0.1e-3))


def test_a_drive_that_turns_its_currents_has_no_images_of_held_phase_currents(
    first: tuple[Path, Calibration],
) -> None:
    run = open_run(first[0])
    config = run.metadata["config"]
    assert 'driver = "sim"' in config
    run.metadata["config"] = config.replace('driver = "sim"', 'driver = "can-dq"')
    hold = recorded_hold(run)
    assert hold is not None
    assert np.isnan(hold.dead_s)
    assert (hold.lag_s, hold.period_s) == (0.2e-3, 1e-3)


def sampled_half_as_often(ticks: np.ndarray) -> np.ndarray:
    """Return the ticks as of a board that has a new sample for every other tick."""
    stale = ticks[1::2]
    for name in ("t_ns", "encoder_count", "torque_Nm", *CURRENTS):
        stale[name] = ticks[name][: 2 * stale.size : 2]
    stale["sample_age_ns"] += 1_000_000
    return ticks


@pytest.fixture(scope="module")
def slow(first: tuple[Path, Calibration]) -> tuple[Path, LearnPass]:
    """Return the pass as of such a board, and what is learned from it."""
    path = change_recording(first[0], first[0].with_name("slow.mcap"), sampled_half_as_often)
    return path, learned_from(path, first[1])


def test_a_board_that_samples_half_as_often_shows_the_same_to_learn_from(
    first: tuple[Path, Calibration], once: LearnPass, slow: tuple[Path, LearnPass]
) -> None:
    """The loop holds its commands as long as before: images and band are the same."""
    path, seen = slow
    assert recorded_hold(open_run(path)) == recorded_hold(open_run(first[0]))
    for one, other in zip(once.ripples, seen.ripples, strict=True):
        assert isinstance(one, SeenRipple)
        assert isinstance(other, SeenRipple)
        assert other.band == pytest.approx(one.band, abs=1)
        learned = np.array([8, 16, 32, 48, 64, 96]) - 1
        assert np.abs(other.line_Nm - one.line_Nm[: other.order.size])[learned].max() < 2e-3


def test_the_band_is_that_of_the_loop_also_where_the_delay_is_not_known(
    first: tuple[Path, Calibration], slow: tuple[Path, LearnPass]
) -> None:
    """Of a board that samples half as often: images stay, orders are learned as high as before."""
    path, known = slow
    run = open_run(path)
    config = run.metadata["config"].replace("actuation_delay_s", "# actuation_delay_s")
    run.metadata["config"] = config.replace("lag_s", "# lag_s")
    subject = Subject.of_config(nonlinear())
    unknown = learn_from_runs([run], subject, first[1], NOW, Learning()).ripples
    for one, other in zip(known.ripples, unknown, strict=True):
        assert isinstance(one, SeenRipple)
        assert isinstance(other, SeenRipple)
        assert other.band == one.band
        assert np.abs(other.line_Nm - one.line_Nm)[47] > 1e-3


def test_the_command_writes_the_next_calibration_and_a_page(
    first: tuple[Path, Calibration], tmp_path: Path
) -> None:
    path, calibration = first
    calibration.save(tmp_path / "c.json")
    options = ("--calibration", tmp_path / "c.json", "-o", tmp_path / "n.json")
    code, out, _ = invoke(app, "learn", path, *options, "--report", tmp_path / "r.html")
    assert code == 0
    figure = r"[\d.]+ \+- [\d.]+ %"
    assert re.search(f"mean {figure}, worst {figure}; 2 of 2 points go on", " ".join(out.split()))
    assert len(re.findall(r"3 Nm\W+[\d.]+ /s\W+[\d.]+ \+- [\d.]+ ", out)) == 2
    assert load(tmp_path / "n.json").learned is not None
    page = (tmp_path / "r.html").read_text()
    assert "Learning the residual torque ripple" in page
    assert page.count("<svg") == 3
    assert re.search(r"<b>[\d.]+\u00a0\u00b1\u00a0[\d.]+ %</b><span>mean RMS error of this", page)
    assert re.search(r"Of this pass, by noise, 95 % intervals are \S+ % at most\.", page)
    code, out, _ = invoke(app, "learn", path, *options[:2], "--finish", "--json")
    result = json.loads(out)
    assert result["schema"] == "motord.learn/1"
    assert result["finished"]
    assert result["points"][0]["correction_mNm"] == 0.0
    [half_width_percent] = result["points"][0]["rms_half_width_percent"]
    assert 0 < half_width_percent < result["points"][0]["rms_percent"][0]
    code, _, error = invoke(app, "learn", path, "--calibration", tmp_path / "n.json")
    assert code == 1
    assert "name the calibration that was in force" in " ".join(error.split())


@pytest.mark.usefixtures("no_pictures")
def test_a_page_shows_the_errors_without_compensation_where_they_are_known(
    once: LearnPass, tmp_path: Path
) -> None:
    from motord.calibration import RmsErrors, RmsPoint

    rms = RmsErrors.of((RmsPoint(torque_Nm=3.0, speed_Hz=0.8, before=7.0),))
    learned = LearnPass(once.calibration.with_rms_error(rms))
    report(learned).write(tmp_path / "r.html")
    assert "Without compensation (%)" in (tmp_path / "r.html").read_text()
