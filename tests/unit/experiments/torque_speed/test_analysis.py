"""From simulation to report on the efficiency bench, against what the rig truly gave and took."""

import csv
import json
import re
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from motord.cli.analysis_command import app as analyse
from motord.config import load, packaged
from motord.experiments.plans import build
from motord.experiments.subject import Recordings
from motord.experiments.torque_speed.recordings import efficiency_map
from motord.experiments.torque_speed.result import EfficiencyMap
from motord.recording.metadata import describe
from motord.recording.reader import bounds_of, open_run
from motord.recording.writer import RunWriter
from motord.results.store import ResultsStore
from motord.simulate import PlanSource, record_plan
from tests.support.wrong_signals import CHANGES, change_recording
from tests.unit.experiments.test_cli import run

BENCH = packaged("../../../config/efficiency.toml")
SETTINGS = {
    "torques_Nm": [-2.0, 3.0], "speeds_Hz": [1.0, 6.0], "turns": 22, "settle_s": 0.5,
}  # fmt: skip


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("torque-speed") / "map.mcap"
    source = PlanSource.of(BENCH)
    record_plan(source, build("torque-speed", source.config, SETTINGS), path, seed=1)
    return path


@pytest.fixture(scope="module")
def straight(recorded: Path) -> EfficiencyMap:
    """Return what is found by the recorded power itself."""
    return efficiency_map(Recordings.open([recorded]))


def true_powers(path: Path, t_start_ns: int, t_end_ns: int) -> tuple[float, float]:
    """Return shaft and DC power that the rig truly had."""
    truth = open_run(path).truth(from_ns=t_start_ns, to_ns=t_end_ns)
    seconds_s = float(np.ptp(truth["t_ns"])) * 1e-9
    shaft_J, dc_J = (truth[f"energy_{n}_J"][[0, -1]] for n in ("shaft", "dc"))
    return float(np.diff(shaft_J)[0]) / seconds_s, float(np.diff(dc_J)[0]) / seconds_s


def test_the_map_is_that_of_the_rig_within_half_a_percent(recorded: Path, tmp_path: Path) -> None:
    output, report, table = tmp_path / "m.json", tmp_path / "m.html", tmp_path / "m.csv"
    store = tmp_path / "store"
    files = ("-o", output, "--report", report, "--csv", table, "--store", store)
    code, text, _ = run(analyse, "torque-speed", recorded, *files)
    assert code == 0
    assert "all of it is lost" in " ".join(text.split())
    found = json.loads(output.read_text())
    assert found["schema"] == "motord.torque-speed/1"
    assert found["findings"] == []
    assert [one["mode"] for one in found["points"]] == [
        "motoring", "motoring", "braking", "generating",
    ]  # fmt: skip
    for one in found["points"]:
        shaft_W, dc_W = true_powers(recorded, one["t_start_ns"], one["t_end_ns"])
        assert one["mechanical_low_W"] < shaft_W < one["mechanical_high_W"]
        assert one["electrical_low_W"] < dc_W < one["electrical_high_W"]
        assert one["loss_low_W"] < dc_W - shaft_W < one["loss_high_W"]
        efficiency = {"motoring": shaft_W / dc_W, "generating": dc_W / shaft_W}.get(one["mode"])
        if efficiency is None:
            assert one["efficiency_percent"] is None
            continue
        assert one["efficiency_percent"] == pytest.approx(100 * efficiency, rel=5e-3)
        assert one["efficiency_low_percent"] < 100 * efficiency < one["efficiency_high_percent"]
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["loss_W"]) for row in rows] == [one["loss_W"] for one in found["points"]]
    assert {(row["plan"], row["setting_turns"]) for row in rows} == {("torque-speed", "22")}
    page = report.read_text()
    assert page.count("<svg") == 2
    assert "slow readings of the power" in page
    assert re.search(r"<b>[\d.]+\u00a0\u00b1\u00a0[\d.]+ W</b><span>losses at ", page)
    kept = {row["field"]: row for row in ResultsStore(store).read().table.to_pylist()}
    one = kept["points.3Nm,6Hz.efficiency_percent"]
    assert one["low"] < one["value"] < one["high"]
    assert one["unit"] == "%"
    assert (one["plan"], one["setting_turns"]) == ("torque-speed", 22.0)
    assert "points.-2Nm,1Hz.loss_W" in kept
    assert "points.-2Nm,1Hz.efficiency_percent" not in kept


def copied(
    recorded: Path,
    path: Path,
    change: dict[str, str],
    channel: bool = True,
    decimals: int = 9,
    bus_ripple: float = 0.0,
) -> Path:
    """Write the recording anew, with changes to the text of its bench file, and DC currents.

    bus_ripple: of the bus voltage of 14 V, in parts; the current's is ten times that in antiphase.
    """
    text = BENCH.read_text()
    for before, after in change.items():
        assert before in text
        text = text.replace(before, after)
    bench = path.with_suffix(".toml")
    bench.write_text(text)
    whole, config = open_run(recorded), load(bench)
    plan = build("torque-speed", config, SETTINGS)
    settings = {**plan.settings, **config.plans.torque_speed.model_dump(include={"power_channel"})}
    metadata = describe(config, text, plan={"name": plan.name, "settings": settings})
    with RunWriter(path, metadata) as writer:
        ticks = whole.ticks()
        if bus_ripple:
            in_turns = 2 * np.pi * 37.0 * 1e-9 * (ticks["t_ns"] - ticks["t_ns"][0])
            ticks["u_bus_V"] *= 1 + bus_ripple * np.sin(in_turns)
        writer.ticks(ticks)
        for point in whole.operating_points():
            writer.operating_point(int(point["t_end_ns"]), point)
        for t_ns, value in zip(*whole.channel("dc_power_W"), strict=True) if channel else ():
            mean_A = value / 14.0 / (1 - 0.5 * 10 * bus_ripple**2)
            content = {"value": round(mean_A, decimals)}
            writer.channel(int(t_ns), "dc_power_W", "W", 3.0, content)
    return path


def test_the_step_in_which_a_current_is_read_is_in_the_intervals(
    recorded: Path, straight: EfficiencyMap, tmp_path: Path
) -> None:
    current = copied(recorded, tmp_path / "c.mcap", {}, decimals=0)
    bench = tmp_path / "c.toml"
    bench.write_text(bench.read_text() + 'bus_current_channel = "dc_power_W"\n')
    found = efficiency_map(Recordings.open([current], bench))
    for one, other in zip(found.points, straight.points, strict=True):
        assert one.loss.low < other.loss.value < one.loss.high
        (share,) = (each for each in one.budget if each.source == "power reading, resolution")
        assert share.loss_W == pytest.approx(0.5 * 14.0 / 3**0.5, rel=0.02)


@pytest.mark.parametrize(("bus_ripple", "names"), [(0.0, []), (0.05, ["bus-voltage-ripple"])])
def test_a_current_that_ripples_with_the_bus_voltage_is_in_the_intervals_and_a_finding(
    recorded: Path,
    straight: EfficiencyMap,
    tmp_path: Path,
    bus_ripple: float,
    names: list[str],
) -> None:
    """Voltage 5 %, current 50 % in antiphase: the mean power is 1.25 % less than that of means."""
    current = copied(recorded, tmp_path / "c.mcap", {}, bus_ripple=bus_ripple)
    bench = tmp_path / "c.toml"
    bench.write_text(bench.read_text() + 'bus_current_channel = "dc_power_W"\n')
    found = efficiency_map(Recordings.open([current], bench))
    assert [one.name for one in found.findings] == names
    for one, other in zip(found.points, straight.points, strict=True):
        assert one.loss.low < other.loss.value < one.loss.high
        rms_W = bus_ripple / 2**0.5 * abs(one.electrical.value)
        assert one.bus_ripple_W == pytest.approx(
            rms_W, rel=0.02, abs=5e-4 * abs(one.electrical.value)
        )
        missed = one.electrical.value / other.electrical.value - 1
        assert missed == pytest.approx(0.5 * 10 * bus_ripple**2, abs=5e-4 if bus_ripple else 1e-4)


@pytest.mark.parametrize(
    ("change", "channel", "message"),
    [
        ({"gain_Nm_per_V = 1.2": "highpass_time_constant_s = 2.0"}, True, "does not show the mean"),
        ({}, False, "has no channel dc_power_W with the DC power; it has none"),
        ({"bus_V = 12.5": 'power_channel = "mains_W"'}, True, "has no channel mains_W"),
    ],
)
def test_what_cannot_be_analysed_is_one_clear_line(
    recorded: Path, tmp_path: Path, change: dict[str, str], channel: bool, message: str
) -> None:
    path = copied(recorded, tmp_path / "x.mcap", change, channel)
    code, _, err = run(analyse, "torque-speed", path)
    assert code == 1
    assert message in " ".join(err.split())


def test_a_count_out_of_range_leaves_out_no_point(
    recorded: Path, straight: EfficiencyMap, tmp_path: Path
) -> None:
    change = CHANGES["encoder out of range at times"]
    path = change_recording(recorded, tmp_path / "run.mcap", change)
    found = efficiency_map(Recordings.open([path]))
    assert (len(found.points), found.left_out) == (len(straight.points), straight.left_out)
    assert "encoder-out-of-range" in {one.name for one in found.findings}


def test_points_without_readings_are_left_out_and_said(recorded: Path, tmp_path: Path) -> None:
    run_ = open_run(recorded)
    points = run_.operating_points()
    bounds = bounds_of(points[0])
    path, text = tmp_path / "gap.mcap", BENCH.read_text()
    metadata = describe(load(BENCH), text, plan={"name": "torque-speed", "settings": SETTINGS})
    with RunWriter(path, metadata) as writer:
        writer.ticks(run_.ticks())
        for point in points:
            writer.operating_point(int(point["t_end_ns"]), point)
        for t_ns, value in zip(*run_.channel("dc_power_W"), strict=True):
            broken = bounds["from_ns"] <= t_ns <= bounds["to_ns"]
            content = {"value": None if broken else value}
            writer.channel(int(t_ns), "dc_power_W", "W", 3.0, content)
    found = efficiency_map(Recordings.open([path]))
    assert len(found.points) == 3
    assert found.left_out == (
        "gap.mcap: 3 Nm, 6 Hz: 0 readings of the power; at least 2 are needed",
    )


def test_each_recording_has_the_power_read_as_its_own_plan_says(recorded: Path) -> None:
    means, instants = open_run(recorded), open_run(recorded)
    instants.metadata = deepcopy(means.metadata)
    instants.metadata["plan"]["settings"]["readings"] = "instants"
    found = efficiency_map(Recordings((means, instants)))
    of_means, of_instants = np.reshape([one.in_step for one in found.points], (2, -1))
    assert (of_means == 0).all()
    assert (of_instants > 0).all()  # looked for where the readings are instants
    assert found.power_source == "dc_power_W"
