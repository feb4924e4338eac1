"""Recordings of a soak, made up: drifts that are in them are found, others are not claimed."""

import json
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from motord.cli.analysis_command import app as analyse
from motord.config import load, packaged
from motord.experiments.plans import build
from motord.experiments.soak.estimate import soak_trends
from motord.experiments.soak.figure_trends import of_repetitions, repetitions_of
from motord.experiments.soak.point_figures import PointFigures
from motord.experiments.soak.result import SoakResult
from motord.experiments.subject import AnalysisError, Recordings
from motord.identification import IdentifyError
from motord.recording.metadata import describe
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.results.query import query
from motord.results.store import ResultsStore
from motord.schema import TICK_DTYPE
from motord.simulate import PlanSource, record_plan
from tests.support.wrong_signals import change_recording
from tests.unit.experiments.test_cli import run
from tests.unit.recording.runs import point_of

SETTINGS = {
    "plan": "verify", "repeats": 12, "pause_s": 300.0, "compensate": "off",
    "inner": {"torques_Nm": [1.0, 2.0], "speeds_Hz": [1.0], "turns": 4},
}  # fmt: skip
HIGHPASS = "highpass_time_constant_s = 2.0"
START_NS = 1_700_000_000_000_000_000
TURN_TICKS = 64
EVERY_NS = round(0.1 * 3.6e12)
FEW = 8
"""Repetitions of the recording that most tests read: when two are left out, six remain."""

pytestmark = pytest.mark.usefixtures("no_search_for_lines")


def captured(
    index: int, repetition: int, rng: np.random.Generator, drift_Nm: float,
    noise_Nm: float = 0.001, zero_Nm: float = 0.0, gain: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Return four turns of a point: ripple of 0.06 Nm RMS and more by and by, and noise."""
    ticks = np.zeros(4 * TURN_TICKS + 2, TICK_DTYPE)
    number = np.arange(ticks.size)
    ticks["tick"] = repetition * 100_000 + (index % 2) * 1000 + number
    ticks["t_ns"] = START_NS + repetition * EVERY_NS + (index % 2) * 10**9 + number * 10**6
    ticks["angle_rad"] = (2 * np.pi * number / TURN_TICKS) % (2 * np.pi)
    ticks["encoder_count"] = number * (4096 // TURN_TICKS) % 4096
    ticks["speed_rad_s"] = 2 * np.pi
    ripple_Nm = np.sqrt(2) * (0.06 + drift_Nm * 0.1 * repetition + 0.0006 * rng.normal())
    ticks["torque_Nm"] = 1.0 + index % 2 + noise_Nm * rng.normal(size=number.size)
    ticks["torque_Nm"] += 0.1 * repetition * (zero_Nm + gain * (1.0 + index % 2))
    ticks["torque_Nm"] += ripple_Nm * np.sin(4 * ticks["angle_rad"])
    ticks["temperature_C"] = 30 + 0.1 * rng.normal()
    ticks["missed"] = 7
    ticks["plan_point"] = index
    return ticks


def write(
    path: Path, repetitions: range, drift_Nm: float = 0.0, seed: int = 1, last_points: int = 2,
    shows_mean: bool = False, channel: str = "winding_C", noise_Nm: float = 0.001,
    set_points: Mapping[str, float] | None = None, zero_Nm: float = 0.0, gain: float = 0.0,
    **settings: object,
) -> Path:  # fmt: skip
    """Write a soak with these repetitions, the last one with fewer points."""
    source, rng = PlanSource.of(), np.random.default_rng([seed, repetitions.start])
    given = {name: one for name, one in {**SETTINGS, **settings}.items() if one is not None}
    plan = build("soak", source.config, given)
    text = source.text.replace(HIGHPASS, "") if shows_mean else source.text
    known = {"name": plan.name, "settings": plan.settings, "run_id": "one"}
    with RunWriter(path, describe(source.config, text, plan=known)) as writer:
        for repetition in repetitions:
            for place in range(last_points if repetition == repetitions[-1] else 2):
                index = 2 * repetition + place
                ticks = captured(index, repetition, rng, drift_Nm, noise_Nm, zero_Nm, gain)
                first_ns, last_ns = int(ticks["t_ns"][0]), int(ticks["t_ns"][-1])
                content = {"value": 40.0 + 20 * 0.1 * repetition + 0.1 * rng.normal()}
                writer.channel(first_ns + 10**6, channel, "degC", 5.0, content)
                writer.ticks(ticks)
                writer.operating_point(last_ns, {
                    "index": index, "repetition": repetition + 1, "inner_index": place,
                    "torque_Nm": 1.0 + place, "speed_Hz": 1.0, "compensate": 0,
                    "tick_start": int(ticks["tick"][0]), "tick_end": int(ticks["tick"][-1]),
                    "t_start_ns": first_ns, "t_end_ns": last_ns, "turns": 4.0, "quality": "ok",
                    **(set_points or {}),
                })  # fmt: skip
    return path


def trends(*paths: Path) -> dict[str, object]:
    return {one.name: one for one in soak_trends(Recordings.open(paths)).trends}


@pytest.fixture(scope="module")
def drifted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("soak") / "soak.mcap", range(12), drift_Nm=0.006)


@pytest.fixture(scope="module")
def found(drifted: Path) -> dict[str, object]:
    return trends(drifted)


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("soak") / "soak.mcap", range(FEW), drift_Nm=0.006)


@pytest.fixture(scope="module")
def of_short(short: Path) -> dict[str, object]:
    return trends(short)


def test_drifts_are_found_with_their_size_and_others_are_not_claimed(
    found: dict[str, object],
) -> None:
    assert {name for name, one in found.items() if one.drifts} == {
        "rms_error_percent", "winding_C", "rms_error_percent of point 1, 1 Nm, 1 Hz",
        "rms_error_percent of point 2, 2 Nm, 1 Hz",
    }  # fmt: skip
    rms, winding = found["rms_error_percent"], found["winding_C"]
    assert rms.low < 0.1 < rms.high  # 0.006 Nm/h of 6 Nm
    assert rms.values[0] == pytest.approx(1.0, rel=0.05)
    assert winding.low < 20.0 < winding.high
    assert (winding.slope_unit, rms.slope_unit) == ("degC/h", "%/h")
    assert found["missed_ticks"].values.tolist() == [0.0] * 12
    np.testing.assert_allclose(rms.hours, 0.1 * np.arange(12), atol=1e-9)


def test_the_command_says_it_draws_it_and_stores_it(
    drifted: Path, found: dict[str, object], tmp_path: Path
) -> None:
    output, report, store = tmp_path / "s.json", tmp_path / "s.html", tmp_path / "store"
    files = ("-o", output, "--report", report, "--store", store)
    code, text, _ = run(analyse, "soak", drifted, *files)
    assert code == 0
    statement = (
        "12 repetitions of verify in 1.1 h: 4 of 7 figures drift: rms_error_percent, winding_C"
    )
    assert statement in " ".join(text.split())
    written = json.loads(output.read_text())
    assert (written["schema"], written["plan"]) == ("motord.soak/1", "verify")
    actions = {one["name"]: one["action"] for one in written["findings"]}
    assert "begin once it is warm" in actions["drift-of-winding-c"]
    page = report.read_text()
    assert page.count("<svg") == 1
    [cards] = re.findall('<div class="cards">.*', page)
    assert re.findall("<span>([^<]*)<", cards)[:2] == [
        "slope of RMS error, 95 %", "slope of winding_C, 95 %",
    ]  # fmt: skip
    assert "\u00b1" in cards
    assert found["rms_error_percent of point 1, 1 Nm, 1 Hz"].title == (
        "RMS error of point 1, 1 Nm, 1 Hz"
    )
    select = "SELECT unit, low, high, plan, setting_plan, setting_inner_turns FROM results "
    [row] = query(
        ResultsStore(store).read().table, f"{select} WHERE field = 'trends.winding_C'"
    ).rows
    assert row[0] == "degC/h"
    assert row[1] < 20.0 < row[2]
    assert row[3:] == ("soak", "verify", 4.0)
    stored = query(ResultsStore(store).read().table, "SELECT field FROM results").rows
    assert not [one for [one] in stored if "hours." in one or "values." in one]
    assert len(next(iter(written["trends"]))["time_series"]["values"]) == 12
    assert "hours" in [one for [one] in stored]


def test_the_mean_torque_is_there_where_the_sensor_shows_it(tmp_path: Path) -> None:
    found = trends(write(tmp_path / "soak.mcap", range(8), shows_mean=True))
    mean = found["torque_mean_Nm of point 2, 2 Nm, 1 Hz"]
    assert mean.mean == pytest.approx(2.0, abs=0.01)
    assert (mean.drifts, mean.slope_unit) == (False, "Nm/h")


@pytest.mark.parametrize(
    ("zero_Nm", "gain", "drifts", "steady"),
    [
        (0.02, 0.0, "torque_zero_Nm", "torque_gain_percent"),
        (0.0, 0.02, "torque_gain_percent", "torque_zero_Nm"),
    ],
)
def test_a_zero_that_drifts_is_distinguished_from_a_gain(
    tmp_path: Path, zero_Nm: float, gain: float, drifts: str, steady: str
) -> None:
    path = write(tmp_path / "soak.mcap", range(13), shows_mean=True, zero_Nm=zero_Nm, gain=gain)
    result = soak_trends(Recordings.open([path]))
    found = {one.name: one for one in result.trends}
    assert found["torque_mean_Nm of point 2, 2 Nm, 1 Hz"].drifts
    assert (found[drifts].drifts, found[steady].drifts) == (True, False)
    for name, true in (("torque_zero_Nm", zero_Nm), ("torque_gain_percent", 100 * gain)):
        assert found[name].low < true < found[name].high
    actions = {one.name: one.action for one in result.findings}
    how = "same at all set-points" if zero_Nm else "goes with the torque"
    assert how in actions[f"drift-of-{drifts.replace('_', '-').lower()}"]


def test_zero_and_gain_are_not_of_the_other_set_points_where_one_mean_is_not_known() -> None:
    points = [
        PointFigures(
            "a", repetition, place, "", torque_Nm, float(repetition), 0.0,
            {"torque_mean_Nm": np.nan if (repetition, place) == (2, 2) else torque_Nm**2}, {}, None,
        )
        for repetition in range(4)
        for place, torque_Nm in enumerate((1.0, 2.0, 3.0))
    ]  # fmt: skip
    found = {one.name: one for one in of_repetitions(repetitions_of(points), points, {})}
    np.testing.assert_allclose(found["torque_gain_percent"].values, [400.0] * 3)
    np.testing.assert_allclose(found["torque_zero_Nm"].values, [-10 / 3] * 3)


def test_a_steady_soak_is_said_to_be_steady(tmp_path: Path) -> None:
    path = write(tmp_path / "soak.mcap", range(12), seed=4)
    found = trends(path)
    assert {name for name, one in found.items() if one.drifts} == {"winding_C"}


def test_a_soak_that_was_stopped_in_a_repetition_is_analysed_as_far_as_it_went(
    tmp_path: Path,
) -> None:
    path = write(tmp_path / "soak.mcap", range(7), last_points=1)
    result = soak_trends(Recordings.open([path]))
    assert [one.complete for one in result.repetitions] == [True] * 6 + [False]
    found = {one.name: one.values.size for one in result.trends}
    assert found["rms_error_percent"] == found["winding_C"] == 6
    assert found["rms_error_percent of point 1, 1 Nm, 1 Hz"] == 7
    assert found["rms_error_percent of point 2, 2 Nm, 1 Hz"] == 6


def test_noise_makes_the_slope_of_the_ripple_no_smaller(tmp_path: Path) -> None:
    """As part of each RMS error, noise of 0.1 Nm made 0.72 +- 0.34 %/h of 1 %/h."""
    found = trends(write(tmp_path / "soak.mcap", range(12), drift_Nm=0.06, noise_Nm=0.1))
    rms, noise = found["rms_error_percent"], found["noise_rms_percent"]
    of_point = found["rms_error_percent of point 1, 1 Nm, 1 Hz"]  # was 0.60 +- 0.36
    assert rms.slope.value == pytest.approx(1.0, abs=0.15)
    assert all(one.low < 1.0 < one.high for one in (rms, of_point))
    assert 1.2 < noise.mean < 100 * 0.1 / 6
    assert noise.low < 0.0 < noise.high


def test_where_noise_hides_the_ripple_no_slope_of_it_is_stated(tmp_path: Path) -> None:
    path = write(tmp_path / "soak.mcap", range(12), drift_Nm=0.06, noise_Nm=0.2)
    result = soak_trends(Recordings.open([path]))
    assert not [one.name for one in result.trends if one.name.startswith("rms_error_percent")]
    assert "noise-hides-ripple" in [one.name for one in result.findings]
    assert "noise_rms_percent" in [one.name for one in result.trends]


def test_what_noise_hides_at_times_is_not_in_the_mean_and_said_to_have_changed(
    tmp_path: Path,
) -> None:
    """From 1 to 20 %, hidden at the first of the repetitions at one of two set-points."""
    path = write(tmp_path / "soak.mcap", range(12), drift_Nm=1.0, noise_Nm=0.2)
    result = soak_trends(Recordings.open([path]))
    found = {one.name: one for one in result.trends}
    mean, of_point = (found[f"rms_error_percent{of}"] for of in ("", " of point 1, 1 Nm, 1 Hz"))
    assert "rms_error_percent of point 2, 2 Nm, 1 Hz" not in found
    np.testing.assert_array_equal(mean.values, of_point.values)
    assert mean.low < 100 * 1.0 / 6 < mean.high
    assert mean.drifts
    [changed] = [one for one in result.findings if one.name == "ripple-changed"]
    assert changed.meaning.startswith("point 2, 2 Nm, 1 Hz, most in repetition 12: the RMS")
    assert changed.value > 15.0 > 3.0 > changed.limit


@pytest.mark.parametrize("inner", [None, 5, "turns", ["turns"]])
def test_without_settings_of_the_inner_plan_there_is_no_ripple(
    short: Path, tmp_path: Path, inner: object
) -> None:
    run, path = open_run(short), tmp_path / "soak.mcap"
    plan = {**run.plan_metadata, "settings": {**run.plan_metadata["settings"], "inner": inner}}
    ticks = run.ticks()
    with RunWriter(path, {**run.metadata, "plan": plan}) as writer:
        writer.ticks(ticks)
        for point in run.operating_points():
            writer.operating_point(int(point["t_ns"]), point)
    assert not [name for name in trends(path) if "rms" in name]


@pytest.mark.parametrize("points", [(0,), (0, 3)])
@pytest.mark.parametrize("column", ["temperature_C", "encoder_count"])
def test_what_is_not_known_of_a_capture_leaves_out_its_repetition_alone(
    short: Path, of_short: dict[str, object], tmp_path: Path, column: str, points: tuple[int, ...]
) -> None:
    """It left the set-point out of the mean, and of two set-points the figure out altogether."""

    def change(ticks: np.ndarray) -> np.ndarray:
        for point in points:
            [at] = np.nonzero(ticks["plan_point"] == point)
            if column == "temperature_C":
                ticks[column][at[5]] = np.nan
            else:
                ticks[column][at] = 7  # no whole turn
        return ticks

    found = trends(change_recording(short, tmp_path / "s.mcap", change))
    lost = points if column == "encoder_count" else ()
    kept = [n for n in range(FEW) if n not in {point // 2 for point in lost}]
    for name in ("rms_error_percent", "noise_rms_percent"):
        np.testing.assert_array_equal(found[name].values, of_short[name].values[kept])
    temperature = "inverter_temperature_C"
    np.testing.assert_allclose(found[temperature].values, of_short[temperature].values, rtol=1e-6)


@pytest.mark.parametrize(
    ("plan", "compensate", "set_points"),
    [
        ("friction", "off", {"torque_Nm": 4.0}),  # accelerates the rotor, which coasts then
        ("align", None, {"torque_Nm": 0.0, "speed_Hz": 0.0}),
    ],
)
def test_points_that_do_not_hold_their_set_point_have_no_ripple(
    tmp_path: Path, plan: str, compensate: str | None, set_points: dict[str, float]
) -> None:
    path, inner = tmp_path / "soak.mcap", {"plan": plan, "inner": {}, "compensate": compensate}
    write(path, range(7), shows_mean=True, set_points=set_points, **inner)
    result = soak_trends(Recordings.open([path]))
    assert "torque-scale" not in [one.name for one in result.findings]
    assert not [one.name for one in result.trends if "rms" in one.name]
    assert [one.name for one in result.trends if one.name.startswith("torque_mean_Nm")]


def test_the_gain_of_the_torque_sensor_is_in_the_interval_of_a_slope(
    found: dict[str, object],
) -> None:
    slope = found["winding_C"]
    assert slope.with_scale(0.0).slope == slope.slope
    wider = slope.with_scale(0.1)
    assert wider.slope.stderr == pytest.approx(np.hypot(slope.slope.stderr, 0.1 * 20), rel=0.02)
    assert wider.high - wider.slope.value > 1.95 * 0.1 * wider.slope.value
    assert wider.slope.p_value == slope.slope.p_value


def test_a_channel_called_like_a_torque_does_not_have_the_gain_of_its_sensor(
    tmp_path: Path,
) -> None:
    channels = ("winding_C", "torque_mean_Nm_brake")
    found = [
        trends(write(tmp_path / f"{one}.mcap", range(7), channel=one))[one] for one in channels
    ]
    assert found[0].slope == found[1].slope


@pytest.mark.parametrize("count", [1, 4])
def test_of_few_repetitions_nothing_is_claimed(tmp_path: Path, count: int) -> None:
    result = soak_trends(Recordings.open([write(tmp_path / "s.mcap", range(count), 0.006)]))
    assert "too few to tell a drift from chance, 6 are needed" in result.statement
    assert result.findings == ()


def test_several_files_are_one_soak_in_any_order(short: Path, tmp_path: Path) -> None:
    parts = [
        write(tmp_path / f"{span.start}.mcap", span, 0.006) for span in (range(4, 8), range(4))
    ]
    found = trends(*parts)["rms_error_percent"]
    assert found.values.size == 8
    assert found.low < 0.1 < found.high


def test_what_is_no_soak_or_another_one_is_refused(short: Path, tmp_path: Path) -> None:
    other = write(tmp_path / "o.mcap", range(2), inner={**SETTINGS["inner"], "turns": 5})
    with pytest.raises(AnalysisError, match=r"o\.mcap: is of another soak than .*soak\.mcap"):
        trends(short, other)
    plain = tmp_path / "plain.mcap"
    config = load()
    with RunWriter(plain, describe(config, packaged("sim.toml").read_text())) as writer:
        writer.ticks(captured(0, 0, np.random.default_rng(1), 0.0))
    with pytest.raises(AnalysisError, match="names no plan; needed: soak"):
        trends(plain)
    unnumbered = tmp_path / "unnumbered.mcap"
    with RunWriter(unnumbered, {**open_run(short).metadata}) as writer:
        ticks = captured(0, 0, np.random.default_rng(1), 0.0)
        writer.ticks(ticks)
        writer.operating_point(START_NS, point_of(ticks))
    with pytest.raises(AnalysisError, match="no good operating point"):
        trends(unnumbered)
    with pytest.raises(AnalysisError, match="no good operating point"):
        trends(write(tmp_path / "none.mcap", range(1), last_points=0))


def test_a_soak_in_virtual_time_from_plan_to_trend(tmp_path: Path) -> None:
    inner = {"speeds_Hz": [2.0], "turns": 2, "settle_s": 0.2}
    settings = {"plan": "back-emf", "inner": inner, "repeats": 2, "pause_s": 1.0}
    source, path = PlanSource.of(), tmp_path / "soak.mcap"
    record_plan(source, build("soak", source.config, settings), path, 1)
    result = soak_trends(Recordings.open([path]))
    assert [(one.repetition, one.complete) for one in result.repetitions] == [(1, True), (2, True)]
    assert result.plan == "back-emf"


@pytest.mark.parametrize("count", [1, 2])
def test_of_a_soak_that_hardly_began_there_is_a_page(tmp_path: Path, count: int) -> None:
    path, report = write(tmp_path / "soak.mcap", range(count)), tmp_path / "s.html"
    code, _, errors = run(analyse, "soak", path, "--report", report)
    assert (code, errors) == (0, "")
    assert report.read_text().count("<svg") == count - 1
    assert ("No figure has two values" in report.read_text()) == (count == 1)


def test_a_channel_called_like_a_figure_of_the_ticks_has_a_name_of_its_own(tmp_path: Path) -> None:
    path = write(tmp_path / "soak.mcap", range(7), channel="missed_ticks")
    names = [one.name for one in soak_trends(Recordings.open([path])).trends]
    assert names.count("missed_ticks") == names.count("channel missed_ticks") == 1


OTHER_ENCODER = (
    r"s\.mcap: repetition 1, point 1, 1 Nm, 1 Hz: encoder counts from 0 to 8064, but the motor"
)


@pytest.mark.parametrize("turned", [False, True])
def test_a_rotor_that_did_not_turn_has_no_ripple_and_counts_of_another_encoder_are_refused(
    tmp_path: Path, short: Path, turned: bool
) -> None:
    def change(ticks: np.ndarray) -> np.ndarray:
        ticks["encoder_count"] = 2 * ticks["encoder_count"] if turned else 7
        return ticks

    path = change_recording(short, tmp_path / "s.mcap", change)
    if turned:
        with pytest.raises(IdentifyError, match=OTHER_ENCODER):
            trends(path)
    else:
        assert not [name for name in trends(path) if "rms" in name]


def test_a_set_point_without_ripple_in_any_repetition_leaves_the_mean_of_the_others(
    short: Path, tmp_path: Path
) -> None:
    """The mean was not stated at all."""

    def change(ticks: np.ndarray) -> np.ndarray:
        ticks["encoder_count"][ticks["plan_point"] % 2 == 0] = 7
        return ticks

    found = trends(change_recording(short, tmp_path / "s.mcap", change))
    both, other = (found[f"rms_error_percent{of}"] for of in ("", " of point 2, 2 Nm, 1 Hz"))
    np.testing.assert_array_equal(both.values, other.values)
    assert "rms_error_percent of point 1, 1 Nm, 1 Hz" not in found


def test_ticks_without_a_column_are_refused_with_what_to_do(
    short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("motord.experiments.soak.point_figures.COLUMNS", ("t_ns", "gone"))
    with pytest.raises(AnalysisError, match=r"soak\.mcap: ticks have no gone; record the soak"):
        trends(short)


def with_counts(short: Path, path: Path, places: slice, count: int) -> SoakResult:
    """Return the result where ticks of a capture have a count that the encoder does not have."""

    def change(ticks: np.ndarray) -> np.ndarray:
        ticks["encoder_count"][np.flatnonzero(ticks["plan_point"] == 5)[places]] = count
        return ticks

    return soak_trends(Recordings.open([change_recording(short, path, change)]))


@pytest.mark.parametrize("count", [5000, -1])
def test_a_count_that_is_out_of_range_is_left_out_alone(
    short: Path, tmp_path: Path, count: int
) -> None:
    """One sample of hours ended the analysis."""
    result = with_counts(short, tmp_path / "s.mcap", slice(7, 8), count)
    assert {one.values.size for one in result.trends if "rms" in one.name} == {FEW}
    [finding] = [one for one in result.findings if one.name == "encoder-out-of-range"]
    assert "2 Nm, 1 Hz" in finding.meaning


@pytest.mark.parametrize("count", [5000, -1])
def test_counts_that_are_out_of_range_leave_out_the_ripple_of_their_capture_alone(
    short: Path, tmp_path: Path, count: int
) -> None:
    result = with_counts(short, tmp_path / "s.mcap", slice(7, 30), count)
    found = {one.name: one.values.size for one in result.trends}
    left = FEW - 1
    assert found["rms_error_percent"] == found["rms_error_percent of point 2, 2 Nm, 1 Hz"] == left
    assert found["rms_error_percent of point 1, 1 Nm, 1 Hz"] == FEW
    [finding] = [one for one in result.findings if one.name == "points-left-out"]
    assert finding.value == 1
    assert "s.mcap: repetition 3, point 2, 2 Nm, 1 Hz: encoder counts from" in finding.meaning


@pytest.mark.parametrize("turns", [True, False])
def test_a_dead_sensor_leaves_out_the_torque_of_its_capture_alone(
    short: Path, tmp_path: Path, turns: bool
) -> None:
    def change(ticks: np.ndarray) -> np.ndarray:
        at = ticks["plan_point"] == 5
        ticks["torque_Nm"][at] = 1.0
        ticks["encoder_count"][at] *= turns
        return ticks

    path = change_recording(short, tmp_path / "s.mcap", change)
    result = soak_trends(Recordings.open([path]))
    found = {one.name: one.values.size for one in result.trends}
    left = FEW - 1
    assert found["rms_error_percent"] == found["rms_error_percent of point 2, 2 Nm, 1 Hz"] == left
    assert found["inverter_temperature_C"] == FEW
    [finding] = [one for one in result.findings if one.name == "points-left-out"]
    assert finding.value == 1
    at = "s.mcap: repetition 3, point 2, 2 Nm, 1 Hz"
    assert f"({at}: torque_Nm is 1 from the first sample" in finding.meaning
