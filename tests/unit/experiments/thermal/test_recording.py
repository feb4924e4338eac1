"""The plan in virtual time on a rig that warms up in seconds, and the analysis of its recording."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.config import AccuracyConfig, packaged
from motord.experiments.plans import build
from motord.experiments.subject import Recordings
from motord.experiments.thermal import ThermalConfig
from motord.experiments.thermal.recordings import copper_of, thermal_course
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.rig.truth import ThermalTruth
from motord.simulate import PlanSource, record_plan

BENCH = packaged("../../../config/thermal.toml")
SETTINGS = {
    "steady_window_s": 2.0, "steady_K_per_min": 60.0, "heating_max_s": 9.0, "cooling_max_s": 6.0,
}  # fmt: skip
QUICK = ThermalTruth(winding_J_per_K=3.0, magnet_J_per_K=4.0, housing_J_per_K=4.0)


def invoke(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(each) for each in arguments])
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of a motor with a hundredth of the usual heat capacity, read at 10 Hz."""
    folder = tmp_path_factory.mktemp("thermal")
    sizes = "\n".join(f"{name} = {getattr(QUICK, name)}" for name in sorted(QUICK.model_fields_set))
    rig = packaged("thermal.rig.toml").read_text().split("[thermal]")[0] + f"[thermal]\n{sizes}\n"
    (folder / "quick.rig.toml").write_text(rig)
    bench = BENCH.read_text().replace("package:thermal.rig.toml", "quick.rig.toml")
    (folder / "quick.toml").write_text(bench.replace("rate_Hz = 2.0", "rate_Hz = 10.0"))
    source = PlanSource.of(folder / "quick.toml")
    plan = build("thermal", source.config, SETTINGS)
    record_plan(source, plan, folder / "heat.mcap", seed=1)
    return folder / "heat.mcap"


def test_current_flows_in_the_heat_up_alone_and_channels_are_recorded(recorded: Path) -> None:
    run = open_run(recorded)
    heating, cooling = run.operating_points()
    assert (heating["index"], cooling["index"]) == (0, 1)
    assert heating["ended_by"] in ("steady", "time limit")
    ticks = run.ticks(["plan_point", "i_a_A", "torque_set_Nm"])
    hot, cold = (ticks[ticks["plan_point"] == number] for number in (0, 1))
    assert np.std(hot["i_a_A"]) > 5.0
    assert np.std(cold["i_a_A"]) < 0.2
    t_ns, value_C = run.channel("winding_C")
    assert np.median(np.diff(t_ns)) == 100_000_000
    assert value_C.max() > 40.0
    truth = run.truth(["t_ns", "winding_C"])
    assert np.interp(t_ns, truth["t_ns"], truth["winding_C"]) == pytest.approx(value_C, abs=0.01)


def test_the_analysis_finds_the_rig(recorded: Path, tmp_path: Path) -> None:
    code, output = invoke(
        "analyse", "thermal", recorded, "-o", tmp_path / "t.json", "--report", tmp_path / "t.html"
    )
    assert code == 0, output
    assert "thermal constants" in output
    found = json.loads((tmp_path / "t.json").read_text())
    assert found["schema"] == "motord.thermal/1"
    assert found["resistance_K_per_W"] == pytest.approx(0.6368, rel=0.02)
    assert found["resistance_low_K_per_W"] < 0.6368 < found["resistance_high_K_per_W"]
    for one in found["capacities"]:
        assert one["capacity_J_per_K"] == pytest.approx(
            getattr(QUICK, f"{one['node']}_J_per_K"), rel=0.02
        )
    page = (tmp_path / "t.html").read_text()
    assert "Heat-up and cooling" in page
    assert page.count("<svg") == 1
    assert re.search(
        r"<td>heat-up</td><td>\d+ s, until (the temperatures were steady|its time)", page
    )


def test_currents_are_compared_with_those_commanded(recorded: Path) -> None:
    measured, _ = thermal_course(Recordings.open([recorded], None))
    assert measured.current_ratios == pytest.approx(np.ones(3), abs=0.05)


def test_another_bench_file_names_other_channels(recorded: Path, tmp_path: Path) -> None:
    bench = (recorded.parent / "quick.toml").read_text()
    named = bench.replace('housing_channel = "housing_C"', 'housing_channel = "case_C"')
    (recorded.parent / "other.toml").write_text(named)
    code, output = invoke("analyse", "thermal", recorded, "-c", recorded.parent / "other.toml")
    assert code == 1
    assert 'has no channel "case_C" (housing_channel of [plans.thermal])' in output
    assert "it has winding_C, magnet_C, housing_C" in output
    assert "Traceback" not in output


def copied(
    recorded: Path,
    path: Path,
    *,
    points: int = 2,
    channels: bool = True,
    gap: bool = False,
    ticks: bool = True,
) -> Path:
    """Return a recording of the same, with less in it."""
    run = open_run(recorded)
    table = run.ticks()
    if gap:
        table = table[(np.arange(table.size) < 1500) | (np.arange(table.size) > 4200)]
    with RunWriter(path, run.metadata) as writer:
        if ticks:
            writer.ticks(np.asarray(table))
        for name, about in run.channels().items() if channels else ():
            for t_ns, value in zip(*run.channel(name), strict=True):
                content = {"value": value, "raw": value, "status": "ok"}
                writer.channel(int(t_ns), name, about.unit, about.timeout_s, content)
        for point in run.operating_points()[:points]:
            writer.operating_point(int(point["t_end_ns"]), point)
    return path


@pytest.mark.parametrize(
    ("less", "why"),
    [
        ({"points": 0}, "no heat-up was ended in it"),
        ({"channels": False}, 'has no channel "winding_C" (winding_channel of [plans.thermal])'),
        ({"ticks": False}, "no ticks in it"),
        ({"gap": True}, "no currents for 5.4 s"),
    ],
)
def test_a_recording_without_what_is_needed_is_refused(
    recorded: Path, tmp_path: Path, less: dict[str, int], why: str
) -> None:
    code, output = invoke("analyse", "thermal", copied(recorded, tmp_path / "less.mcap", **less))
    assert (code, why in output, "Traceback" in output) == (1, True, False), output


def test_the_heat_follows_from_the_resistance_and_its_tolerance() -> None:
    own = ThermalConfig(resistance_ohm=0.2, resistance_C=20.0, resistance_tolerance=0.03)
    copper = copper_of(own, AccuracyConfig(current_gain_percent=2.0))
    heat_W = copper.heat_W(np.array([10.0, 10.0]), np.array([20.0, 120.0]))
    assert heat_W == pytest.approx([2.0, 2.0 * 1.393])
    assert copper.heat_uncertainty == pytest.approx(np.hypot(0.03, 0.04) / np.sqrt(3))
    assert not copper_of(ThermalConfig(), AccuracyConfig()).known


def test_a_cooling_that_was_stopped_is_used_and_said(recorded: Path, tmp_path: Path) -> None:
    path = copied(recorded, tmp_path / "stopped.mcap", points=1)
    code, output = invoke("analyse", "thermal", path, "--json")
    assert code == 0, output
    found = json.loads(output)
    assert found["ended_by"][1] == "stopped"
    assert "cooling-cut-short" in [one["name"] for one in found["findings"]]


def test_a_recording_of_another_plan_is_refused(recorded: Path, tmp_path: Path) -> None:
    run = open_run(recorded)
    with RunWriter(
        tmp_path / "other.mcap", {**run.metadata, "plan": {"name": "cogging"}}
    ) as writer:
        writer.ticks(np.asarray(run.ticks()))
    code, output = invoke("analyse", "thermal", tmp_path / "other.mcap")
    assert (code, "needed: thermal" in output) == (1, True)
