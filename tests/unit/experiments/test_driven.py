"""Recordings of driven rotors through analysis, command line, bench file and report."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from motord.calibration import CalibratedMotor
from motord.cli import app
from motord.config import Config, MotorConfig, load, packaged
from motord.config.motor.back_emf import BackEmfTable
from motord.control import parameters
from motord.experiments.analysis import encode
from motord.experiments.back_emf import estimate as back_emf
from motord.experiments.back_emf.between_speeds import Delay
from motord.experiments.back_emf.findings import findings
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.experiments.cogging import estimate as cogging
from motord.experiments.cogging.at_speed import REQUIRED
from motord.experiments.cogging.findings import findings as cogging_findings
from motord.experiments.cogging.result import MeasuredCogging
from motord.experiments.driven_rotor import driven_points
from motord.experiments.plans import build
from motord.experiments.subject import AnalysisError, Subject
from motord.identification import IdentifyError
from motord.identification.rotor.left_out import LeftOut
from motord.recording.metadata import describe
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.schema import TICK_DTYPE
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan
from tests.unit.test_calibration import make

COGGING = {"speeds_Hz": [0.8, 1.0], "turns": 6, "settle_s": 0.5}
BACK_EMF = {"speeds_Hz": [0.6, 1.2], "turns": 8, "settle_s": 0.5}


def record(path: Path, name: str, config: Config, **settings: object) -> None:
    bench = VirtualBench(config, seed=4)
    text = packaged("sim.toml").read_text()
    with RunWriter(path, describe(config, text)) as writer:
        for point in run_plan(
            bench,
            build(name, config, settings),
            lambda ticks, truth: (writer.ticks(ticks), writer.truth(truth)),
        ):
            writer.operating_point(int(point["t_end_ns"]), point)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("driven")
    record(folder / "cogging.mcap", "cogging", load(), **COGGING)
    record(folder / "emf.mcap", "back-emf", load(), **BACK_EMF)
    return folder


@pytest.fixture(scope="module")
def table(runs: Path) -> Path:
    path = runs / "table.json"
    done = motord("back-emf", runs / "emf.mcap", "-o", path)
    assert done.exit_code == 0, done.output
    return path


def motord(kind: str, *arguments: object):
    return CliRunner().invoke(app, ["analyse", kind, *map(str, arguments)])


def test_cogging_on_the_command_line(runs: Path, tmp_path: Path) -> None:
    motor = load().motor
    angle_rad = 2 * np.pi * np.arange(motor.counts) / motor.counts
    tau_Nm = 0.08 * np.sin(16 * angle_rad + 0.6) + 0.04 * np.sin(32 * angle_rad - 1.1)
    tau_Nm += 0.33 * np.sin(48 * angle_rad + 0.3) + 0.06 * np.sin(96 * angle_rad + 1.4)
    calibration = make(motor=CalibratedMotor.of(motor), tau_cog_Nm=tuple(tau_Nm))
    calibration.save(tmp_path / "c.json")
    done = motord(
        "cogging", runs / "cogging.mcap", "--calibration", tmp_path / "c.json",
        "-o", tmp_path / "r.json", "--report", tmp_path / "r.html",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "main order 48" in done.output
    assert "of the measured peak" in done.output
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["schema"] == "motord.cogging/1"
    assert result["main_order"] == 48
    assert len(result["tau_cog_Nm"]) == 4096
    by_order = {h["order"]: h for h in result["harmonics"]}
    assert set(by_order[48]) == {
        "order", "amplitude_Nm", "phase_rad", "stderr_Nm", "phase_stderr_rad", "half_width_Nm",
        "phase_half_width_rad", "allowed",
    }  # fmt: skip
    for order, amplitude_Nm, phase_rad in ((16, 0.08, 0.6), (48, 0.33, 0.3), (96, 0.06, 1.4)):
        assert by_order[order]["amplitude_Nm"] == pytest.approx(amplitude_Nm, abs=2e-3)
        assert by_order[order]["phase_rad"] == pytest.approx(phase_rad, abs=0.03)
        assert by_order[order]["allowed"]
    assert result["comparison"]["worst_error_percent"] < 2.0
    assert [speed["turns"] for speed in result["speeds"]] == [5, 5]
    page = (tmp_path / "r.html").read_text()
    assert "Figure 3.2" in page
    assert "Figure 4.5" in page
    assert page.count("<figure>") == 4
    [finding] = result["findings"]
    assert finding["name"] == "one-direction"
    assert "- note: one-direction, 1 direction (limit 2): friction" in done.output
    assert '<div class="finding note"><b>one-direction</b>' in page
    assert page.index("one-direction") < page.index("<h2 ")


def test_back_emf_on_the_command_line(runs: Path, tmp_path: Path) -> None:
    done = motord("back-emf", runs / "emf.mcap", "--report", tmp_path / "r.html")
    assert done.exit_code == 0, done.output
    assert "older" in done.output
    page = (tmp_path / "r.html").read_text()
    assert "Back-EMF over speed" in page
    assert page.count("<svg") == 1
    done = motord("back-emf", runs / "emf.mcap", "--json")
    result = json.loads(done.output)
    first = result["harmonics"][0]
    assert first["order"] == 1
    assert first["amplitude_V_s_per_rad"] == pytest.approx(0.206, rel=2e-3)
    assert first["phase_rad"] == pytest.approx(0.0, abs=5 * first["phase_stderr_rad"])
    assert [one["name"] for one in result["findings"]] == ["phase-drift-not-seen"]  # two speeds
    assert {span["reason"] for span in result["left_out"]} == {"part of a turn"}
    assert {h["order"] for h in result["phases"]["c"]} >= {8, 24, 40, 56}


def test_the_table_is_a_motors_back_emf(runs: Path, table: Path, tmp_path: Path) -> None:
    text = packaged("sim.toml").read_text()
    begin = text.index("back_emf = [")
    end = text.index("]\n", text.index("order = 7")) + 2
    bench = tmp_path / "bench.toml"
    bench.write_text(
        text.replace(text[begin:end], 'back_emf = "table.json"\n').replace(
            'rig = "report.rig.toml"', 'rig = "package:report.rig.toml"'
        )
    )
    (tmp_path / "table.json").write_text(table.read_text())
    config, nominal = load(bench), load()
    assert isinstance(config.motor.back_emf, BackEmfTable)
    k = config.motor.back_emf_table()
    assert np.abs(k - nominal.motor.back_emf_table()).max() < 0.003 * 0.206
    assert np.array_equal(parameters.build(config)[1], k)
    make(motor=CalibratedMotor.of(nominal.motor), tau_cog_Nm=(0.0,) * 4096).check_motor(
        config.motor
    )
    run = tmp_path / "run.mcap"
    mesh = {"torques_Nm": [1.0, 4.0], "speeds_Hz": [1.0], "turns": 5, "settle_s": 0.5}
    record(run, "calibrate", config, **mesh)
    (tmp_path / "table.json").unlink()
    subject = Subject.of_runs([open_run(run)])
    assert np.array_equal(subject.motor.back_emf_table(), k)
    done = motord("calibrate", run, "--json")
    assert done.exit_code == 0, done.output
    alpha = np.array(json.loads(done.output)["alpha"])
    assert alpha == pytest.approx([0.8, 1.118, 1.118], rel=0.01)


def elsewhere(path: Path, ticks: np.ndarray, metadata: dict | None = None) -> Path:
    """Write a recording that holds time, position and torque, and no operating points."""
    foreign = np.zeros(ticks.size, TICK_DTYPE)
    for name in TICK_DTYPE.names or ():
        if TICK_DTYPE[name].kind == "f":
            foreign[name] = np.nan
    for name in ("t_ns", "tick", "encoder_count", "torque_Nm"):
        foreign[name] = ticks[name]
    config = load()
    with RunWriter(path, metadata or describe(config, packaged("sim.toml").read_text())) as writer:
        writer.ticks(foreign)
    return path


def test_a_whole_recording_from_elsewhere_with_a_slow_start(runs: Path, tmp_path: Path) -> None:
    ticks = open_run(runs / "cogging.mcap").ticks()
    path = elsewhere(tmp_path / "foreign.mcap", ticks)
    done = motord("cogging", path, "--json")
    assert done.exit_code == 0, done.output
    result = json.loads(done.output)
    by_order = {h["order"]: h["amplitude_Nm"] for h in result["harmonics"] if h["allowed"]}
    assert by_order[48] == pytest.approx(0.33, abs=4e-3)
    assert by_order[16] == pytest.approx(0.08, abs=4e-3)
    assert len(result["speeds"]) >= 2
    done = motord("back-emf", path)
    assert done.exit_code == 1
    assert "nothing was recorded in u_a_V, u_b_V, u_c_V: no phase voltages" in done.output
    assert len(done.output.strip().splitlines()) == 1


def test_points_from_elsewhere_are_cut_into_steady_stretches(runs: Path, tmp_path: Path) -> None:
    run = open_run(runs / "cogging.mcap")
    ticks = run.ticks()
    path = tmp_path / "points.mcap"
    with RunWriter(path, run.metadata) as writer:
        writer.ticks(ticks)
        whole = {"index": 0, "torque_Nm": 0.0, "speed_Hz": 0.0, "quality": "ok", "compensate": 0}
        whole |= {"tick_start": int(ticks["tick"][0]), "tick_end": int(ticks["tick"][-1])}
        whole |= {"t_start_ns": int(ticks["t_ns"][0]), "t_end_ns": int(ticks["t_ns"][-1])}
        writer.operating_point(int(ticks["t_ns"][-1]), whole)
    opened = open_run(path)
    found = measured_cogging(opened, Subject.of_runs([opened]))
    assert {0.8, 1.0} <= {round(one.speed_Hz, 2) for one in found.speeds}


def test_a_capture_whose_ticks_were_lost_ends_no_analysis(runs: Path, tmp_path: Path) -> None:
    """As in a recording of which a part was damaged."""
    run = open_run(runs / "cogging.mcap")
    first, second = run.operating_points()
    path = tmp_path / "lost.mcap"
    with RunWriter(path, run.metadata) as writer:
        writer.ticks(run.ticks(to_ns=first["t_end_ns"]))
        for point in (first, second):
            writer.operating_point(int(point["t_end_ns"]), point)
    sizes = [point.ticks.size for point in driven_points([open_run(path)], REQUIRED)]
    assert sizes[0] > 0
    assert sizes[1:] == [0]


def test_what_is_wrong_is_reported(runs: Path, tmp_path: Path) -> None:
    run = open_run(runs / "cogging.mcap")
    path = tmp_path / "bad.mcap"
    with RunWriter(path, run.metadata) as writer:
        writer.ticks(run.ticks())
        for point in run.operating_points():
            writer.operating_point(1, {**point, "quality": "speed off by 12 %"})
    done = motord("cogging", path)
    assert done.exit_code == 1
    assert "none of its operating points is of good quality" in done.output
    empty = tmp_path / "empty.mcap"
    with RunWriter(empty, run.metadata) as writer:
        writer.operating_point(1, {**run.operating_points()[0]})
    done = motord("cogging", empty)
    assert done.exit_code == 1
    assert "no ticks" in done.output
    other = make(motor=CalibratedMotor.of(load().motor).model_copy(update={"slots": 36}),
                 tau_cog_Nm=(0.0,) * 4096)  # fmt: skip
    other.save(tmp_path / "c.json")
    done = motord("cogging", runs / "cogging.mcap", "--calibration", tmp_path / "c.json")
    assert done.exit_code == 1
    assert "another motor" in done.output


class Narrow:
    """A recording with some columns only."""

    def __init__(self, run, *missing: str) -> None:
        self.path, self.metadata, self._run = run.path, run.metadata, run
        self.columns = tuple(name for name in run.columns if name not in missing)

    def operating_points(self) -> list[dict]:
        return self._run.operating_points()

    def ticks(self, columns, **bounds: int) -> np.ndarray:
        assert set(columns) <= set(self.columns)
        return self._run.ticks(columns, **bounds)


def measured_cogging(run: object, subject: Subject) -> MeasuredCogging:
    points = driven_points([run], REQUIRED)
    return cogging.measure(points, subject.motor, subject.sensor)


def measured_back_emf(run: object, subject: Subject) -> MeasuredBackEmf:
    return back_emf.measure(driven_points([run], back_emf.VOLTAGES), subject.motor)


def test_columns_that_are_not_there(runs: Path) -> None:
    run = open_run(runs / "cogging.mcap")
    subject = Subject.of_runs([run])
    currents = ("i_a_A", "i_b_A", "i_c_A", "i_age_ns")
    measured = measured_cogging(Narrow(run, "encoder_count", *currents), subject)
    assert measured.amplitude_Nm[measured.order == 48] == pytest.approx(0.33, abs=5e-3)
    for missing, expected in (
        (("torque_Nm",), "the recording has no torque_Nm"),
        (("encoder_count", "angle_rad"), "has neither encoder_count nor angle_rad"),
    ):
        with pytest.raises(AnalysisError, match=expected):
            measured_cogging(Narrow(run, *missing), subject)


def test_a_mesh_is_no_driven_run(tmp_path: Path) -> None:
    path = tmp_path / "mesh.mcap"
    mesh = {"torques_Nm": [3.0], "speeds_Hz": [1.0], "turns": 4, "settle_s": 0.5}
    record(path, "calibrate", load(), **mesh)
    run = open_run(path)
    with pytest.raises(IdentifyError, match="needs a run without current"):
        measured_back_emf(run, Subject.of_runs([run]))


def test_phases_in_the_other_order_and_unlike_phases_are_findings(runs: Path) -> None:
    run = open_run(runs / "emf.mcap")
    found = measured_back_emf(run, Subject.of_runs([run]))
    assert [one.name for one in found.findings] == ["phase-drift-not-seen"]  # two speeds
    found = replace(found, speeds_Hz=(*found.speeds_Hz, 1.5))

    def names(**changes: object) -> list[str]:
        return [one.name for one in findings(replace(found, **changes), [])]

    assert names(line=found.line[:, [0, 2, 1]]) == ["phase-order"]
    assert names(line=found.line * [1.0, 1.0, 1.02]) == ["phases-differ"]
    assert names(delay_s=None) == ["age-not-seen"]
    assert names(delay_s=Delay(5.1e-3, 1e-4, 20)) == ["age-of-voltages"]
    odd = np.append([8], found.order[1:] + 1)
    assert "unexplained-orders" in names(order=odd)
    lost = LeftOut("point 1", "at another speed", 0.0, 9.0, 9.0)
    assert names(left_out=(lost,)) == ["data-left-out"]


def test_an_encoder_offset_is_in_the_harmonics_and_not_in_the_table(runs: Path) -> None:
    run = open_run(runs / "emf.mcap")
    plain = Subject.of_runs([run])
    offset_rad = 0.11
    content = {**plain.motor.model_dump(), "encoder_offset_rad": offset_rad}
    turned = Subject(plain.bench, MotorConfig.model_validate(content), plain.sensor)
    results = []
    for subject in (plain, turned):
        found = measured_back_emf(run, subject)
        results.append(encode(found))
    assert results[0]["k_V_s_per_rad"] == results[1]["k_V_s_per_rad"]
    kept = [
        {"order": h["order"], "amplitude_V_s_per_rad": h["amplitude_V_s_per_rad"],
         "phase_rad": h["phase_rad"]}
        for h in results[1]["harmonics"] if h["in_table"]
    ]  # fmt: skip
    again = MotorConfig.model_validate({**content, "back_emf": kept}).back_emf_table()
    assert np.abs(again - np.array(results[1]["k_V_s_per_rad"])).max() < 0.003 * 0.206


def test_findings_of_a_cogging_run(runs: Path) -> None:
    run = open_run(runs / "cogging.mcap")
    subject = Subject.of_runs([run])
    measured = measured_cogging(run, subject)
    assert [one.name for one in measured.findings] == ["one-direction"]
    changed = replace(
        measured, main_order=7200, allowed=measured.order != 48, speeds=measured.speeds[:1]
    )
    found = {one.name: one for one in cogging_findings(changed, 10.0)}
    assert set(found) == {"main-order-not-seen", "unexplained-orders", "few-turns", "one-direction"}
    assert "stand out of the noise: 48" in found["unexplained-orders"].meaning
