"""The plan and the analysis on the packaged rig, from simulation to report; what is refused."""

import json
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.config import Config, ConfigError, load, packaged
from motord.config.experiments import plan_kinds
from motord.experiments.friction import FrictionConfig
from motord.experiments.friction.command import COLUMNS, coast_downs, inertia_of
from motord.experiments.friction.estimate import measure
from motord.experiments.friction.result import Inertia
from motord.experiments.plans import build
from motord.identification import IdentifyError
from motord.recording.metadata import describe
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.rig.truth import load as load_truth
from motord.sequencing import PlanError
from motord.virtual import PlanFailed, VirtualBench, run_plan
from motord.virtual.mesh import processors
from motord.virtual.preflight import forecasts
from tests.support.wrong_signals import CHANGES, change_recording

INERTIA_KG_M2, COULOMB_NM, VISCOUS_NM_S_PER_RAD = 0.0105, 0.03, 0.002


def invoke(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(each) for each in arguments])
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("friction") / "friction.mcap"
    code, output = invoke("simulate", "friction", "-o", path, "--set", "repeats=6")
    assert code == 0, output
    return path


@pytest.fixture(scope="module")
def inertia(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("inertia") / "inertia.json"
    content = {
        "schema": "motord.inertia/1",
        "inertia_kg_m2": INERTIA_KG_M2,
        "uncertainty_kg_m2": 0.01 * INERTIA_KG_M2,
        "motor": "axial-flux 48/16",
    }
    path.write_text(json.dumps(content))
    return path


@dataclass(frozen=True)
class Analysed:
    """What the analysis of the recording prints, writes and draws."""

    text: str
    found: dict[str, Any]
    page: str


@pytest.fixture(scope="module")
def analysed(recorded: Path, inertia: Path) -> Analysed:
    output, report = recorded.with_name("f.json"), recorded.with_name("f.html")
    arguments = ("--inertia", inertia, "-o", output, "--report", report)
    code, text = invoke("analyse", "friction", recorded, *arguments)
    assert code == 0, text
    return Analysed(text, json.loads(output.read_text()), report.read_text())


def test_the_packaged_rig_has_the_friction_that_is_found(analysed: Analysed) -> None:
    assert "Coulomb (mNm)" in analysed.text
    assert "no Stribeck part seen" in analysed.text
    assert "(inertia.json, +-2 %)" in analysed.text  # it is of this motor
    found = analysed.found
    assert found["schema"] == "motord.friction/1"
    assert found["coast_downs"] == 12
    assert [one["direction"] for one in found["directions"]] == ["forwards", "backwards"]
    for one in found["directions"]:
        assert one["coulomb_Nm"] == pytest.approx(COULOMB_NM, rel=0.05)
        assert one["coulomb_low_Nm"] < COULOMB_NM < one["coulomb_high_Nm"]
        viscous = one["viscous_Nm_s_per_rad"]
        assert viscous == pytest.approx(VISCOUS_NM_S_PER_RAD, rel=0.1)
        low, high = one["viscous_low_Nm_s_per_rad"], one["viscous_high_Nm_s_per_rad"]
        assert low < VISCOUS_NM_S_PER_RAD < high
        assert one["stribeck"] is None
    assert analysed.page.count("<svg") == 3
    assert "Friction torque over speed" in analysed.page


def test_a_count_out_of_range_is_left_out_and_said(
    recorded: Path, analysed: Analysed, inertia: Path, tmp_path: Path
) -> None:
    """A coast-down ended there, as if the rotor had turned back, or began with it."""
    change = CHANGES["encoder out of range at times"]
    changed = change_recording(recorded, tmp_path / "run.mcap", change)
    content, unnamed = json.loads(inertia.read_text()), tmp_path / "inertia.json"
    del content["motor"]  # which it need not state
    unnamed.write_text(json.dumps(content))
    found = json.loads(invoke("analyse", "friction", changed, "--inertia", unnamed, "--json")[1])
    assert [one["name"] for one in found["findings"]] == ["encoder-out-of-range"]
    for one, other in zip(found["directions"], analysed.found["directions"], strict=True):
        assert one["coulomb_Nm"] == pytest.approx(other["coulomb_Nm"], rel=1e-3)


def recording(ticks: np.ndarray, points: list[dict[str, Any]]) -> Any:
    """Return what stands in for a run with these ticks and operating points."""
    return SimpleNamespace(
        path=Path("run.mcap"),
        columns=ticks.dtype.names,
        operating_points=lambda: points,
        ticks=lambda *_, **__: ticks,
    )


def test_a_fault_is_of_the_coast_down_of_that_index() -> None:
    """Not of its place among the good ones: the third was blamed for the fourth."""
    ticks = np.zeros(200, [(name, np.int64) for name in (*COLUMNS, "plan_point")])
    ticks["t_ns"], ticks["encoder_count"] = 10**6 * np.arange(200), 40 * np.arange(200) % 4096
    ticks["encoder_count"][50], ticks["plan_point"] = 10**6, 3
    point = {"index": 3, "tick_start": 0, "t_start_ns": 0, "t_end_ns": 10**9}
    run = recording(ticks, [{**point, "index": 2, "quality": "bad"}, point])
    _, [fault], _ = coast_downs([run], load().motor)
    assert "run.mcap: coast-down 4" in fault.meaning


def test_a_coast_down_is_forwards_whichever_way_the_encoder_counts(recorded: Path) -> None:
    run = open_run(recorded)
    motor = load().motor.model_copy(update={"encoder_direction": -1})
    coasts, _, _ = coast_downs([run], motor)
    forwards = [point["speed_Hz"] > 0 for point in run.operating_points()]
    assert [one.direction > 0 for one in coasts] == forwards


def test_a_coast_down_with_lost_turns_is_left_out_and_said() -> None:
    """It ended the analysis of all the others."""
    ticks = np.zeros(2000, [(name, np.int64) for name in (*COLUMNS, "plan_point")])
    number = np.arange(2000)
    ticks["t_ns"], ticks["encoder_count"] = 10**6 * number, 40 * number % 4096
    ticks["plan_point"] = number // 1000
    gap = ticks[(number < 1400) | (number > 1460)]
    points = [{"index": n, "tick_start": n, "t_start_ns": 0, "t_end_ns": 10**10} for n in range(2)]
    [_], [], left_out = coast_downs([recording(gap, points)], load().motor)
    [reason] = left_out.reasons
    assert reason.startswith("run.mcap: coast-down 2: 0.062 s without usable samples")
    [finding] = left_out.findings()
    assert finding.name == "points-left-out"
    assert f"({reason})" in finding.meaning


def spoiled(ticks: np.ndarray, how: str) -> None:
    """Spoil the ticks of one coast-down."""
    half = ticks.size // 2
    if how == "other counts":
        ticks["encoder_count"][:half] = 65535
    elif how == "times":
        ticks["t_ns"][half] = ticks["t_ns"][half - 2]
    elif how == "short":
        ticks["encoder_count"] = ticks["encoder_count"][0]
    else:
        ticks["torque_set_Nm"][half] = 0.1


def test_ticks_that_repeat_a_sample_leave_no_coast_down_out() -> None:
    """The clocks of loop and board alone make one every half minute."""
    ticks = np.zeros(2000, [(name, np.int64) for name in (*COLUMNS, "plan_point")])
    number = np.arange(2000)
    ticks["t_ns"], ticks["encoder_count"] = 10**6 * number, 40 * number % 4096
    ticks["plan_point"] = number // 1000
    ticks[700], ticks[1300] = ticks[699], ticks[1299]
    points = [{"index": n, "tick_start": n, "t_start_ns": 0, "t_end_ns": 10**10} for n in range(2)]
    found, faults, left_out = coast_downs([recording(ticks, points)], load().motor)
    assert ([one.t_s.size for one in found], faults) == ([999, 999], ())
    assert not left_out.reasons


REASONS = {
    "other counts": "encoder counts from",
    "times": "times go back",
    "short": "the rotor coasted for 0 turns only",
    "torque": "a torque was commanded",
}


@pytest.mark.parametrize("how", REASONS)
def test_one_coast_down_that_cannot_be_used_ends_no_analysis(how: str) -> None:
    """Whatever its error is: it ended the analysis of all the others, some without a file name."""
    names = ("plan_point", *COLUMNS)
    ticks = np.zeros(6000, [(n, float if n == "torque_set_Nm" else np.int64) for n in names])
    number = np.arange(6000)
    ticks["t_ns"], ticks["encoder_count"] = 10**6 * number, 40 * number % 4096
    ticks["plan_point"] = number // 1000
    part = ticks[2000:3000]
    spoiled(part, how)
    points = [{"index": n, "tick_start": n, "t_start_ns": 0, "t_end_ns": 10**10} for n in range(6)]
    found, faults, left_out = coast_downs([recording(ticks, points)], load().motor)
    [reason] = left_out.reasons
    assert (len(found), faults) == (5, ())
    assert reason.startswith(f"run.mcap: coast-down 3: {REASONS[how]}")
    with (
        pytest.raises(IdentifyError, match=r"2 good coast-downs forw.* left out: run\.mcap: co"),
        left_out.explaining(),
    ):
        measure(found[:2], load().motor, Inertia(1e-3, 0.0, ""))


def test_without_an_inertia_it_says_what_to_do(recorded: Path) -> None:
    code, text = invoke("analyse", "friction", recorded)
    assert code == 1
    assert "motord analyse inertia" in text
    assert "inertia_kg_m2" in text


def test_an_inertia_of_another_motor_is_said(recorded: Path, inertia: Path, tmp_path: Path) -> None:
    other = tmp_path / "inertia.json"
    other.write_text(
        json.dumps(json.loads(inertia.read_text()) | {"motor": "pump \x1b[31m", "freedom": 3.0})
    )
    code, text = invoke("analyse", "friction", recorded, "--inertia", other)
    assert code == 0, text
    assert r"(inertia.json, of another motor, 'pump \x1b[31m', +-3.2 %)" in text


def test_an_inertia_of_steps_that_repeat_well_has_any_number_of_degrees_of_freedom(
    inertia: Path, tmp_path: Path
) -> None:
    """Steps that scatter by a thousandth of the uncertainty make 1e12 for each of their own."""
    other = tmp_path / "inertia.json"
    other.write_text(json.dumps(json.loads(inertia.read_text()) | {"freedom": 4e12}))
    known = inertia_of(other, FrictionConfig(), "")
    assert known.half_width == pytest.approx(1.96 * known.relative_uncertainty, rel=1e-4)


def test_the_inertia_may_stand_in_the_bench_file(recorded: Path, tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    rig = packaged("report.rig.toml")
    text = packaged("sim.toml").read_text().replace('"report.rig.toml"', f'"{rig}"')
    bench.write_text(text + "\n[plans.friction]\ninertia_kg_m2 = 0.021\ninertia_tolerance = 0.1\n")
    code, output = invoke("analyse", "friction", recorded, "-c", bench, "--json")
    assert code == 0, output
    found = json.loads(output)
    assert found["inertia_relative_uncertainty"] == pytest.approx(0.1 / 3**0.5)
    assert found["directions"][0]["coulomb_Nm"] == pytest.approx(2 * COULOMB_NM, rel=0.05)


@pytest.mark.parametrize("content", ["", "{}", '{"schema": "motord.inertia/1"}', "[1]"])
def test_a_file_that_is_no_inertia_is_refused(recorded: Path, tmp_path: Path, content: str) -> None:
    path = tmp_path / "j.json"
    path.write_text(content)
    code, text = invoke("analyse", "friction", recorded, "--inertia", path)
    assert code == 1
    assert "is no result of `motord analyse inertia" in text


@pytest.mark.parametrize(
    ("plan", "message"), [({"name": "verify"}, "is of the plan verify"), ({}, "names no plan")]
)
def test_recordings_of_another_plan_are_refused(
    tmp_path: Path, inertia: Path, plan: dict[str, str], message: str
) -> None:
    path = tmp_path / "other.mcap"
    with RunWriter(path, describe(load(), packaged("sim.toml").read_text(), plan=plan)):
        pass
    code, text = invoke("analyse", "friction", path, "--inertia", inertia)
    assert code == 1
    assert message in text


def test_a_recording_without_coast_downs_is_refused(tmp_path: Path, inertia: Path) -> None:
    path = tmp_path / "empty.mcap"
    plan = {"name": "friction", "settings": {}}
    with RunWriter(path, describe(load(), packaged("sim.toml").read_text(), plan=plan)):
        pass
    code, text = invoke("analyse", "friction", path, "--inertia", inertia)
    assert code == 1
    assert text.startswith("motord: ")


def test_coast_downs_go_both_ways_in_turn_and_are_without_torque(recorded: Path) -> None:
    run = open_run(recorded)
    points = run.operating_points()
    assert [point["torque_Nm"] > 0 for point in points] == [True, False] * 6
    assert {point["quality"] for point in points} == {"ok"}
    for point in points:
        ticks = run.ticks(
            ("torque_set_Nm", "plan_point", "speed_rad_s"),
            from_ns=int(point["t_start_ns"]),
            to_ns=int(point["t_end_ns"]),
        )
        assert not ticks["torque_set_Nm"].any()
        assert abs(float(ticks["speed_rad_s"][0])) > 2 * 3.14 * 2.0


def test_a_dry_run_finds_every_point_fine() -> None:
    config = load()
    plan = build("friction", config, {"repeats": 1})
    with processors() as pool:
        found = list(forecasts(config, plan, None, pool, 120.0))
    assert [each.fine for each in found] == [True, True]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"torque_Nm": 60.0}, "above .limits. torque_Nm"),
        ({"start_speed_Hz": 3.0}, " Hz, 80 % of .limits. trip_speed_rad_s"),
        ({"stop_speed_Hz": 2.5}, "stop_speed_Hz must be below start_speed_Hz"),
        ({"speed_Hz": 1.0}, "setting speed_Hz"),
        ({"compensate": "on"}, "compensate is always 'off'"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(PlanError, match=message):
        build("friction", load(), settings)


def test_the_rise_of_its_torque_takes_nothing_of_its_time() -> None:
    """The rotor comes loose after more than two seconds of the torque's rise."""
    config = load()
    truth = load_truth(packaged("report.rig.toml"))
    plan = build("friction", config, {"repeats": 1, "torque_Nm": 0.5, "timeout_s": 2.0})
    points = run_plan(VirtualBench(config, truth, seed=1), plan, lambda ticks, truth: None)
    assert {point["index"] for point in points} == {0, 1}


def test_a_rotor_that_does_not_come_loose_is_reported() -> None:
    config = load()
    truth = load_truth(packaged("report.rig.toml"))
    plan = build("friction", config, {"torque_Nm": 0.01, "timeout_s": 1.0})
    reason = "2 Hz not reached within 1 s after the torque rose; is the rotor free"
    with pytest.raises(PlanFailed, match=reason):
        run_plan(VirtualBench(config, truth, seed=1), plan, lambda ticks, truth: None)


def test_an_unknown_key_of_its_section_is_named(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(packaged("sim.toml").read_text() + "\n[plans.friction]\nrepeat = 3\n")
    with pytest.raises(ConfigError, match=r"plans\.friction\.repeat"):
        load(bench)


def test_keys_of_its_section() -> None:
    config: Config = load()
    settings = plan_kinds()["friction"].settings.model_dump()
    assert set(settings) == {
        "start_speed_Hz", "stop_speed_Hz", "torque_Nm", "repeats", "timeout_s", "temperature_C",
        "inertia_kg_m2", "inertia_tolerance",
    }  # fmt: skip
    assert len(build("friction", config, {"repeats": 3}).points) == 6
