"""Recordings of both experiments for the inertia, analysed, reported, and by the command."""

import json
from pathlib import Path
from shutil import copy

import numpy as np
import pytest
from typer.testing import CliRunner

from motord.calibration import CalibratedMotor, Calibration
from motord.cli import app
from motord.config import load, packaged
from motord.experiments.inertia import command as analysis
from motord.experiments.inertia.report import fill, in_thousandths
from motord.experiments.plans import build
from motord.experiments.subject import AnalysisError, Subject
from motord.identification import IdentifyError
from motord.recording.metadata import describe
from motord.recording.reader import Run, open_run
from motord.recording.writer import RunWriter
from motord.report.html import Page
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan
from tests.support.wrong_signals import CHANGES, change_recording

TRUTH_KG_M2 = 0.0105


def record(bench_file: str, name: str, path: Path, seed: int = 7, **settings: object) -> Path:
    config = load(packaged(bench_file))
    plan = build(name, config, settings)
    plan_metadata = {"name": plan.name, "settings": plan.settings}
    metadata = describe(config, packaged(bench_file).read_text(), plan=plan_metadata)
    with RunWriter(path, metadata) as writer:
        for point in run_plan(
            VirtualBench(config, seed=seed),
            plan,
            lambda ticks, truth: writer.ticks(ticks),
        ):
            writer.operating_point(int(point["t_end_ns"]), point)
    return path


@pytest.fixture(scope="module")
def swings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("inertia") / "swings.mcap"
    return record("inertia.toml", "inertia-oscillation", path, repeats=3)


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("inertia") / "steps.mcap"
    return record("sim.toml", "inertia-acceleration", path, repeats=4, rest_s=1.5)


def invoke(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["analyse", "inertia", *map(str, arguments)])
    return result.exit_code, result.output


def test_oscillation_from_a_recording(swings: Path, tmp_path: Path) -> None:
    code, output = invoke(swings, "-o", tmp_path / "j.json")
    assert code == 0, output
    assert "spring constants" in output
    assert "whole decay fitted" in output
    result = json.loads((tmp_path / "j.json").read_text())
    assert result["schema"] == "motord.inertia/1"
    assert result["experiment"] == "inertia-oscillation"
    assert result["inertia_kg_m2"] == pytest.approx(TRUTH_KG_M2, rel=2e-3)
    low, high = result["interval_95_kg_m2"]
    assert low < TRUTH_KG_M2 < high
    assert len(result["releases"]) == 3
    assert result["budget"][0]["source"] == "spring constants"


@pytest.mark.usefixtures("no_pictures")
def test_acceleration_from_a_recording(steps: Path, tmp_path: Path) -> None:
    code, output = invoke(steps, "--json", "--report", tmp_path / "j.html")
    assert code == 0, output
    result = json.loads(output)
    assert result["experiment"] == "inertia-acceleration"
    error = result["inertia_kg_m2"] - TRUTH_KG_M2
    assert abs(error) < 3 * result["uncertainty_kg_m2"]
    assert len(result["steps"]) == 4
    assert "high-pass undone" in (tmp_path / "j.html").read_text()
    code, output = invoke(steps)
    assert code == 0
    assert "torque as commanded" in output


def test_ticks_without_a_torque_are_left_out(steps: Path, tmp_path: Path) -> None:
    run, path = open_run(steps), tmp_path / "gaps.mcap"
    ticks = run.ticks().copy()
    ticks["torque_Nm"][::7] = np.nan
    with RunWriter(path, run.metadata) as writer:
        writer.ticks(ticks)
        for point in run.operating_points():
            writer.operating_point(point["t_ns"], point)
    found = [
        analysis.acceleration([each], Subject.of_runs([each])) for each in (run, open_run(path))
    ]
    assert found[1].inertia_kg_m2 == pytest.approx(found[0].inertia_kg_m2, rel=2e-3)


@pytest.mark.parametrize("recording", ["swings", "steps"])
def test_counts_out_of_range_are_left_out_and_said(
    recording: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    source = request.getfixturevalue(recording)
    change = CHANGES["encoder out of range at times"]
    path = change_recording(source, tmp_path / "run.mcap", change)
    sound, found = (json.loads(invoke(one, "--json")[1]) for one in (source, path))
    assert "encoder-out-of-range" in {one["name"] for one in found["findings"]}
    assert found["inertia_kg_m2"] == pytest.approx(sound["inertia_kg_m2"], rel=1e-4)


def test_releases_keep_their_numbers_if_one_is_left_out(swings: Path, tmp_path: Path) -> None:
    """Others had its number, by which the report names them."""

    def stuck(ticks: np.ndarray) -> np.ndarray:
        ticks["encoder_count"][ticks["plan_point"] == 1] = 7
        return ticks

    path = change_recording(swings, tmp_path / "run.mcap", stuck)
    found = json.loads(invoke(path, "--json")[1])
    assert [one["index"] for one in found["releases"]] == [0, 2]
    [left_out] = [one for one in found["findings"] if one["name"] == "points-left-out"]
    assert "(run.mcap: release 2: a release hardly moves" in left_out["meaning"]


def test_a_bench_file_says_what_the_springs_really_are(swings: Path, tmp_path: Path) -> None:
    text = packaged("inertia.toml").read_text()
    stiffer = text.replace("stiffness_N_per_m = 3", "stiffness_N_per_m = 4")
    rig = packaged("inertia.rig.toml")
    (tmp_path / "bench.toml").write_text(stiffer.replace('"inertia.rig.toml"', f'"{rig}"'))
    code, output = invoke(swings, "--json", "-c", tmp_path / "bench.toml")
    assert code == 0, output
    assert json.loads(output)["inertia_kg_m2"] > 1.3 * TRUTH_KG_M2


def test_a_motor_file_leaves_the_springs_as_recorded(steps: Path, tmp_path: Path) -> None:
    motor = load().motor.model_dump(mode="json", exclude_none=True)
    lines = [f"{k} = {json.dumps(v)}" for k, v in motor.items() if k != "back_emf"]
    lines += ["back_emf = [{order = 1, amplitude_V_s_per_rad = 0.206}]"]
    sensor = "[torque_sensor]\nhighpass_time_constant_s = 2.0\n"
    (tmp_path / "motor.toml").write_text("[motor]\n" + "\n".join(lines) + "\n" + sensor)
    code, output = invoke(steps, "--json", "-c", tmp_path / "motor.toml")
    assert code == 0, output
    assert json.loads(output)["inertia_kg_m2"] == pytest.approx(TRUTH_KG_M2, rel=0.03)


def test_both_on_one_page_with_the_truth(swings: Path, steps: Path, tmp_path: Path) -> None:
    runs = open_run(swings), open_run(steps)
    subject = Subject.of_runs(runs[:1])
    page = Page("both")
    fill(page, analysis.oscillation(runs[:1], subject), TRUTH_KG_M2)
    alone = page.html()
    for text in ("Figures 2.6 to 2.9", "Figure 2.4", "Figure 2.2"):
        assert text in alone
    assert "CAD" not in alone  # what Poels 2008 measured is for `motord reproduce` alone
    assert alone.count("<svg") == 4
    fill(page, analysis.acceleration(runs[1:], Subject.of_runs(runs[1:])), TRUTH_KG_M2)
    page.write(tmp_path / "both.html")
    text = (tmp_path / "both.html").read_text()
    assert "off the truth (%)" in text
    assert text.index("by oscillation") < text.index("by acceleration")
    assert (tmp_path / "both.html").stat().st_size < 1_500_000


def test_the_inertia_of_a_small_motor_has_as_many_digits() -> None:
    assert in_thousandths(0.0105) == "10.500"
    assert in_thousandths(1.2345e-7) == "0.00012345"


def test_steps_of_recordings_of_one_name_all_count(steps: Path, tmp_path: Path) -> None:
    """In folders of their own: those of the last were used alone, without a word."""
    runs = [open_run(steps), open_run(Path(copy(steps, tmp_path)))]
    found = analysis.acceleration(runs, Subject.of_runs(runs))
    assert [one.index for one in found.steps] == list(range(8))


def test_releases_left_out_of_recordings_of_one_name_count_each(
    swings: Path, tmp_path: Path
) -> None:
    """Two of one number seemed one, and the next releases of the other file had its places."""
    (tmp_path / "first").mkdir()
    path = change_recording(swings, tmp_path / "first" / "swings.mcap", without_second_release)
    runs = [open_run(path), open_run(Path(copy(path, tmp_path)))]
    found = analysis.oscillation(runs, Subject.of_runs(runs))
    [left_out] = [one for one in found.findings if one.name == "points-left-out"]
    assert left_out.value == 2
    assert [one.index for one in found.releases] == [0, 2, 3, 5]


def without_second_release(ticks: np.ndarray) -> np.ndarray:
    ticks["encoder_count"][ticks["plan_point"] == 1] = 65535
    return ticks


def test_a_swing_with_the_stator_needs_to_know_its_cogging_torque(
    swings: Path, tmp_path: Path
) -> None:
    text = packaged("inertia.toml").read_text()
    bench = tmp_path / "bench.toml"
    rig = packaged("inertia.rig.toml")
    bench.write_text(
        text.replace("[plans.inertia-oscillation]", "[plans.inertia-oscillation]\nstator = true")
        .replace('"inertia.rig.toml"', f'"{rig}"')
    )  # fmt: skip
    code, output = invoke(swings, "-c", bench)
    assert code == 1
    assert "a frequency cannot separate the two" in " ".join(output.split())
    calibrated(tmp_path / "cal.json")
    code, output = invoke(swings, "-c", bench, "--calibration", tmp_path / "cal.json", "--json")
    assert code == 0, output
    found = json.loads(output)["inertia_kg_m2"]
    # the table is of a torque that was not there: it must make a difference, no more
    assert found != pytest.approx(TRUTH_KG_M2, rel=2e-3)
    assert found == pytest.approx(TRUTH_KG_M2, rel=0.2)
    calibrated(tmp_path / "other.json", slots=36)
    code, output = invoke(swings, "-c", bench, "--calibration", tmp_path / "other.json")
    assert code == 1
    assert "was made for another motor: slots is 36 there and 48 here" in " ".join(output.split())


def test_releases_of_different_set_ups_are_not_taken_for_one(swings: Path, tmp_path: Path) -> None:
    """The springs of the first recording counted for all, so the inertia went with the order."""
    other = tmp_path / "other.mcap"
    record("inertia.toml", "inertia-oscillation", other, 8, repeats=1, bar_inertia_kg_m2=0.008)
    code, output = invoke(swings, other)
    said = "".join(output.split())
    assert (code, "in bar_inertia_kg_m2; analyse them".replace(" ", "") in said) == (1, True), said
    code, output = invoke(swings, other, "-c", packaged("inertia.toml"))
    assert code == 0, output


def test_a_calibration_that_does_nothing_is_refused(
    swings: Path, steps: Path, tmp_path: Path
) -> None:
    calibrated(tmp_path / "cal.json")
    for recording, why in (
        (swings, "stator = false), so no cogging torque acted: leave out --calibration"),
        (steps, "--calibration is for releases of a bar"),
    ):
        code, output = invoke(recording, "--calibration", tmp_path / "cal.json")
        assert (code, why in " ".join(output.split())) == (1, True), output


def calibrated(path: Path, **motor_values: object) -> None:
    from datetime import UTC, datetime

    motor = load(packaged("inertia.toml")).motor
    angle_rad = 2 * np.pi * np.arange(motor.counts) / motor.counts
    Calibration(
        created=datetime.now(UTC),
        motor=CalibratedMotor.of(motor).model_copy(update=motor_values),
        method="joint",
        alpha=(1.0, 1.0, 1.0),
        alpha_stderr=(0.0, 0.0, 0.0),
        beta_A=(0.0, 0.0, 0.0),
        beta_stderr_A=(0.0, 0.0, 0.0),
        tau_cog_Nm=tuple((0.1 * np.sin(48 * angle_rad)).tolist()),
        condition_number=1.0,
    ).save(path)


def test_a_recording_that_marks_nothing_is_searched_for_releases(
    swings: Path, tmp_path: Path
) -> None:
    marked = open_run(swings)
    bare = tmp_path / "bare.mcap"
    with RunWriter(bare, {**marked.metadata, "plan": {}}) as writer:
        for block in marked.blocks():
            writer.ticks(block)
    code, output = invoke(bare)
    assert code == 1
    assert "--experiment" in output
    bench = packaged("inertia.toml")
    code, output = invoke(bare, "--experiment", "inertia-oscillation", "-c", bench, "--json")
    assert code == 0, output
    result = json.loads(output)
    assert len(result["releases"]) + len(result["disturbed"]) == 3
    assert result["inertia_kg_m2"] == pytest.approx(TRUTH_KG_M2, rel=2e-3)
    code, output = invoke(swings, "--experiment", "inertia-acceleration")
    assert code == 1
    assert "these are recordings of inertia-oscillation" in output
    code, output = invoke(bare, "--experiment", "inertia-acceleration")
    assert code == 1
    assert "no good step" in output


def test_a_recording_without_marks_and_of_another_encoder_is_left_out(
    swings: Path, tmp_path: Path
) -> None:
    """Its error ended the analysis of all, as one without ticks did."""
    bare, empty = tmp_path / "bare.mcap", tmp_path / "empty.mcap"
    marked = open_run(swings)
    with RunWriter(bare, marked.metadata) as writer, RunWriter(empty, marked.metadata):
        for block in marked.blocks():
            block["encoder_count"] += 4096
            writer.ticks(block)
    runs = [open_run(bare), open_run(empty), marked]
    found = analysis.oscillation(runs, Subject.of_runs(runs))
    [left_out] = [one for one in found.findings if one.name == "points-left-out"]
    assert "(bare.mcap: encoder counts from " in left_out.meaning
    assert len(found.releases) + len(found.disturbed) == 3
    with pytest.raises(IdentifyError, match=r"no good release.*left out: bare\.mcap: encoder"):
        analysis.oscillation(runs[:1], Subject.of_runs(runs[:1]))


def test_other_recordings_are_refused(swings: Path, steps: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    for plan, message in (({"name": "verify"}, "is of the plan verify"), ({}, "names no plan")):
        config = load()
        metadata = describe(config, packaged("sim.toml").read_text(), plan=plan)
        other.unlink(missing_ok=True)
        with RunWriter(other, metadata):
            pass
        with pytest.raises(AnalysisError, match=message):
            analysis.experiment_of([open_run(other)])
    with pytest.raises(AnalysisError, match="analyse them apart"):
        analysis.experiment_of([open_run(swings), open_run(steps)])
    with pytest.raises(AnalysisError, match="no recording"):
        analysis.experiment_of([])


def test_settings_that_cannot_be_read_are_refused(swings: Path) -> None:
    run: Run = open_run(swings)
    run.metadata["plan"]["settings"]["springs"] = "six"
    with pytest.raises(AnalysisError, match="this version cannot read the settings of its plan"):
        analysis.oscillation([run], Subject.of_runs([run]))
