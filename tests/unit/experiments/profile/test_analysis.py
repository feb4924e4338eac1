"""What is found of a profile that was played, against the truth of the simulated rig."""

import json
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from motord.calibration import Calibration, load
from motord.config import packaged
from motord.experiments.plans import build
from motord.experiments.profile import ProfileConfig
from motord.experiments.profile.command import ANALYSIS, estimate
from motord.experiments.profile.cycle_torque import slow_square
from motord.experiments.profile.estimate import (
    BEFORE_TIME_CONSTANTS,
    COLUMNS,
    _asked_for,
    _cycle,
    _Signals,
    measure,
)
from motord.experiments.profile.report import DOTS_MAX, over_plane
from motord.experiments.profile.result import ProfileTracking
from motord.experiments.subject import AnalysisError, Recordings
from motord.identification.signal_condition import MISREAD_IN_ROWS_SHARE
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


@cache
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
    assert on.torque_rms_Nm.value < 0.12 < 0.3 < off.torque_rms_Nm.value < 0.5
    assert on.speed_within_percent == 100.0
    assert [finding.name for finding in on.findings] == []
    assert [finding.name for finding in off.findings] == [
        "speed-off-the-profile", "torque-off-the-profile",
    ]  # fmt: skip
    speed = off.cycles[0].speed
    assert speed.rms < speed.max == pytest.approx(off.speed_max_Hz, rel=0.2)
    assert 0 <= speed.max_at_s <= 14


def test_the_rms_error_of_the_torque_is_without_the_noise_of_its_sensor(played: Played) -> None:
    """Of a bench that ripples less than its sensor is noisy; a note says so."""
    for path, noisy in ((played.off, False), (played.on, True)):
        result = found(path, played.calibration)
        rms_Nm = result.torque_rms_Nm
        assert rms_Nm.low < true_torque_rms_Nm(path) < rms_Nm.high
        noise_Nm = np.sqrt([one.moments.noise.variance for one in result.cycles])
        assert noise_Nm == pytest.approx(0.02, rel=0.1)
        assert any("is white noise of" in note for note in result.notes) == noisy


def true_torque_rms_Nm(path: Path) -> float:
    run = open_run(path)
    each_Nm = []
    for point in run.operating_points():
        ticks = run.ticks(COLUMNS, **bounds_of(point))
        ticks = ticks[ticks["plan_point"] == int(point["index"])]
        truth = run.truth(None, **bounds_of(point))
        truth = truth[np.isin(truth["t_ns"], ticks["t_ns"])]
        _, wanted_Nm = _asked_for((ticks["t_ns"] - ticks["t_ns"][0]) * 1e-9, ticks)
        each_Nm.append(np.sqrt(np.mean((truth["torque_Nm"] - wanted_Nm) ** 2)))
    return float(np.mean(each_Nm))


@pytest.mark.parametrize("ripple_Nm", [0.0, 0.002, 0.02])
@pytest.mark.parametrize("cycles", [1, 3])
def test_an_rms_error_below_the_noise_is_held(cycles: int, ripple_Nm: float) -> None:
    """In 95 % of 200 trials, less three standard errors of a share; below 0 there is none."""
    held = 0
    for seed in range(200):
        rms_Nm = noisy(seed, cycles, ripple_Nm).torque_rms_Nm
        assert 0 <= rms_Nm.low <= rms_Nm.value < rms_Nm.high
        held += rms_Nm.low <= ripple_Nm <= rms_Nm.high
    assert held >= 200 * (0.95 - 3 * (0.95 * 0.05 / 200) ** 0.5)


def test_a_drift_of_the_sensor_is_in_the_interval_of_the_rms_error() -> None:
    """20 mNm RMS of ripple that there is, and a drift as large, alike in all cycles."""
    off = repeated()
    drifted = tuple(
        replace(
            one,
            torque=replace(one.torque, rms=0.02 * 2**0.5),
            moments=replace(one.moments, square_Nm2=8e-4, drift_Nm2=4.1e-4),
        )
        for one in off.cycles
    )
    stated = replace(off, cycles=drifted, torque_uncertainty=0.0).torque_rms_Nm
    assert stated.low < 0.02 < stated.value
    assert stated.value - stated.low < 0.01


def test_slow_torque_is_taken_apart_from_ripple() -> None:
    t_s = np.arange(8000) * 1e-3
    slow_Nm = 0.02 * np.sqrt(2) * np.cos(2 * np.pi * 0.125 * t_s)
    ripple_Nm = 0.3 * np.cos(2 * np.pi * 40 * t_s)
    found_Nm2 = slow_square(t_s, slow_Nm + ripple_Nm, 0.5)
    assert found_Nm2 == pytest.approx(4e-4, rel=0.03)
    assert slow_square(t_s, ripple_Nm, 0.5) < 1e-6


def noisy(seed: int, cycles: int, ripple_Nm: float) -> ProfileTracking:
    """Cycles of 4 s at 2 Nm with a ripple of this RMS by a sensor with 20 mNm of white noise."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(4000) * 1e-3
    wanted_Nm, speed_Hz = np.full(t_s.size, 2.0), np.full(t_s.size, 0.7)
    ripple = np.sqrt(2) * ripple_Nm * np.cos(2 * np.pi * 48 * 0.7 * t_s)
    found = []
    for index in range(cycles):
        torque_Nm = wanted_Nm + ripple + rng.normal(0, 0.02, t_s.size)
        signals = _Signals(t_s, speed_Hz, speed_Hz, wanted_Nm, torque_Nm, 2 * np.pi * 0.7 * t_s)
        found.append(_cycle(signals, index, "made-up", ProfileConfig()))
    return ProfileTracking("p.csv", "", 0.1, 0.1, 0.0, "made up", tuple(found))


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


def test_without_a_calibration_energy_and_torque_error_have_no_interval(played: Played) -> None:
    result = found(played.off)
    assert result.energy_J.value == pytest.approx(np.mean(true_energy_J(played.off)), rel=0.03)
    assert result.energy_J.low is None
    assert result.torque_rms_Nm.low is result.torque_rms_Nm.stderr is None
    assert "name the calibration with --calibration" in result.notes[0]


def test_a_sensor_that_passes_the_mean_needs_no_currents(played: Played) -> None:
    recordings = Recordings.open([played.on])
    subject = recordings.subject
    passes = replace(
        subject,
        sensor=subject.sensor.model_copy(update={"highpass_time_constant_s": 0.0}),
        accuracy=subject.accuracy.model_copy(update={"torque_zero_Nm": 0.05}),
    )
    recordings.__dict__["subject"] = passes
    result = measure(recordings, None)
    relative = 1.96 * subject.accuracy.torque_gain_percent / 100 / np.sqrt(3)
    half_J = result.energy_J.high - result.energy_J.value
    assert half_J >= relative * abs(result.energy_J.value)
    assert result.notes[0] == "torque: as the sensor measures it"
    assert result.torque_zero_Nm == pytest.approx(0.05 / np.sqrt(3))
    assert found(played.on).torque_zero_Nm == 0.0


def test_a_serial_number_that_a_plan_was_started_with_may_be_new_to_the_calibration(
    played: Played, tmp_path: Path
) -> None:
    known = load(played.calibration)
    motor = known.motor.model_copy(update={"serial": ""})
    Calibration(**{**dict(known), "motor": motor, "id": ""}).save(tmp_path / "cal.json")
    energy_J = estimate(Recordings.open([played.on]), tmp_path / "cal.json").energy_J
    assert energy_J == found(played.on, played.calibration).energy_J


def test_the_energy_has_its_sign_whichever_way_the_encoder_counts(played: Played) -> None:
    recordings = Recordings.open([played.off])
    motor = recordings.subject.motor.model_copy(update={"encoder_direction": -1})
    recordings.__dict__["subject"] = replace(recordings.subject, motor=motor)
    assert measure(recordings, None).energy_J.value == found(played.off).energy_J.value > 0


def repeated(zero_Nm: float = 0.0, gain: float = 1.0, error_Nm: float = 0.0) -> ProfileTracking:
    """Two cycles at 2 Nm, alike, with 20 mNm of ripple RMS, by a torque sensor that is off.

    error_Nm: mean of the error that there is; the sensor is known to 0.1 % (standard uncertainty).
    """
    t_s = np.linspace(0, 10, 2001)
    ripple_Nm = 0.02 * np.sqrt(2) * np.sin(2 * np.pi * 5 * t_s)
    wanted_Nm, speed_Hz = np.full(t_s.size, 2.0), np.full(t_s.size, 0.7)
    torque_Nm = gain * (wanted_Nm + ripple_Nm + error_Nm) + zero_Nm
    signals = _Signals(t_s, speed_Hz, speed_Hz, wanted_Nm, torque_Nm, 2 * np.pi * 0.7 * t_s)
    cycles = tuple(_cycle(signals, index, "made-up", ProfileConfig()) for index in range(2))
    return ProfileTracking("p.csv", "", 0.1, 0.1, 1e-3, "made up", cycles)


@pytest.mark.parametrize("zero_Nm", [-0.05, 0.05])
@pytest.mark.parametrize("error_Nm", [0.0, -0.05, 0.05])
@pytest.mark.parametrize("figure", ["torque_mean_Nm", "energy_J", "power_mean_W", "torque_rms_Nm"])
def test_the_zero_of_a_sensor_that_passes_the_mean_is_in_the_intervals(
    figure: str, error_Nm: float, zero_Nm: float
) -> None:
    """A zero at its limit, alike in all cycles, whose scatter does not show it.

    Also where the sensor shows no mean error, as its zero is as large as the one that there is.
    """
    true = getattr(repeated(error_Nm=error_Nm), figure).value
    without = repeated(zero_Nm, error_Nm=error_Nm)
    alone = getattr(without, figure)
    assert not alone.low < true < alone.high
    stated = getattr(replace(without, torque_zero_Nm=0.05 / np.sqrt(3)), figure)
    assert stated.low < true < stated.high
    assert stated.high - stated.value < 1.96 * np.hypot(alone.stderr, _moved(figure))


def _moved(figure: str) -> float:
    """Return a little more than what a standard uncertainty of the zero moves a figure at most."""
    of_torque = {"energy_J": 2 * np.pi * 7, "power_mean_W": 2 * np.pi * 0.7}
    return float(1.01 * 0.05 / np.sqrt(3) * of_torque.get(figure, 1.0))


@pytest.mark.parametrize("gain", [0.995, 1.005])
@pytest.mark.parametrize("error_Nm", [0.0, -0.01, 0.01])
def test_the_gain_of_the_torque_is_in_the_interval_of_its_rms_error(
    error_Nm: float, gain: float
) -> None:
    true_Nm = repeated(error_Nm=error_Nm).torque_rms_Nm.value
    off = repeated(gain=gain, error_Nm=error_Nm)
    alone = replace(off, torque_uncertainty=0.0).torque_rms_Nm  # cycles are alike
    assert not alone.low < true_Nm < alone.high
    found = replace(off, torque_uncertainty=0.005 / np.sqrt(3)).torque_rms_Nm
    assert abs(found.value - true_Nm) > 1e-4
    assert found.low < true_Nm < found.high
    assert found.high - found.value < 1.96 * 1.01 * 0.005 / np.sqrt(3) * 2.02


def test_an_rms_error_that_is_mostly_a_mean_is_as_unsure_as_the_zero() -> None:
    """And a small part of it only, where the mean of the error is small against its ripple."""
    large, none = (
        replace(repeated(error_Nm=mean), torque_uncertainty=0.0, torque_zero_Nm=1e-3).torque_rms_Nm
        for mean in (1.0, 0.0)
    )
    assert large.stderr == pytest.approx(1e-3, rel=1e-3)
    assert none.stderr == pytest.approx((np.hypot(0.02, 1.96e-3) - 0.02) / 1.96, rel=0.01)


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
    result = found(played.on, played.calibration)
    content = json.loads(json.dumps(ANALYSIS.to_json(result, recordings)))
    assert content["schema"] == "motord.profile/1"
    assert content["energy_low_J"] < content["energy_J"] < content["energy_high_J"]
    assert [cycle["cycle"] for cycle in content["cycles"]] == [1, 2, 3]
    assert len(content["sha256"]) == 64
    kept = {figure.field: figure for figure in figures(content)}
    assert kept["energy_J"].unit == "J"
    assert kept["energy_J"].low == content["energy_low_J"]
    page = ANALYSIS.page(result, recordings).html()
    assert page.count("<svg") == 3
    for part in ("Torque and speed over time", "SHA-256", content["sha256"], "mechanical energy"):
        assert part in page
    for heading in ("speed error RMS (turns/s)", "torque error RMS (Nm)", "asked (J)"):
        assert heading in page
    assert any("torque: as the sensor" in str(line) for line in ANALYSIS.lines(result, recordings))


def test_limits_can_be_set_for_its_figures(played: Played) -> None:
    from motord.config.experiments import analysis_kinds

    recordings = Recordings.open([played.off])
    content = ANALYSIS.to_json(found(played.off, played.calibration), recordings)
    for kind in analysis_kinds()["profile"].figures:
        [figure] = figures_of(kind, content, {})
        assert figure.value is not None


def test_recordings_of_other_profiles_or_plans_are_refused(played: Played, tmp_path: Path) -> None:
    source = PlanSource.of(None)
    given = {"file": str(write(tmp_path / "q.csv", ROWS[:4])), "repeats": 1}
    record_plan(source, build("profile", source.config, given), tmp_path / "q.mcap", 4)
    with pytest.raises(AnalysisError, match="another profile"):
        measure(Recordings.open([played.off, tmp_path / "q.mcap"]), None)
    slower = build("profile", source.config, {**given, "speed_factor": 0.9})
    record_plan(source, slower, tmp_path / "slower.mcap", 4)
    with pytest.raises(AnalysisError, match="other factors"):
        measure(Recordings.open([tmp_path / "q.mcap", tmp_path / "slower.mcap"]), None)
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


def test_a_count_out_of_range_is_left_out_of_a_cycle(played: Played, tmp_path: Path) -> None:
    """It was an index beyond the tables of the calibration."""
    change = CHANGES["encoder out of range at times"]
    result = found(
        change_recording(played.on, tmp_path / "changed.mcap", change), played.calibration
    )
    assert "encoder-out-of-range" in {one.name for one in result.findings}
    [sound, disturbed] = (one.cycles[0] for one in (found(played.on, played.calibration), result))
    assert disturbed.energy_J == pytest.approx(sound.energy_J, rel=1e-3)


def test_counts_misread_in_rows_are_many_or_few_in_the_cycle_alone(
    played: Played, tmp_path: Path
) -> None:
    """Next to the time before it, from which its torque is followed, they were too few to see."""
    run = open_run(played.on)
    points = run.operating_points()
    tau_s = Recordings.open([played.on]).subject.sensor.highpass_time_constant_s
    bounds = bounds_of(points[-1])
    cycle = run.ticks(("plan_point",), **bounds).size
    bounds["from_ns"] -= round(BEFORE_TIME_CONSTANTS * tau_s * 1e9)
    longer = run.ticks(("plan_point",), **bounds).size
    rows = round(MISREAD_IN_ROWS_SHARE * np.sqrt(cycle * longer)) // 2
    assert cycle < 2 * rows / MISREAD_IN_ROWS_SHARE < longer

    def change(ticks: np.ndarray) -> np.ndarray:
        last = ticks["plan_point"] == int(points[-1]["index"])
        at = np.flatnonzero(last & (np.abs(ticks["speed_rad_s"]) > 1))
        for first in at[:: at.size // rows][:rows]:
            ticks["encoder_count"][first : first + 2] ^= 1 << 10
        return ticks

    path = change_recording(played.on, tmp_path / "changed.mcap", change)
    result = found(path, played.calibration)
    assert len(result.cycles) == len(points) - 1
    [left_out] = [one for one in result.findings if one.name == "points-left-out"]
    assert "several in a row" in left_out.meaning


def test_an_earlier_take_of_a_cycle_is_no_part_of_it(played: Played, tmp_path: Path) -> None:
    """Which ended within the time before the cycle from which on its torque is followed."""
    last = open_run(played.on).operating_points()[-1]
    begins_ns = bounds_of(last)["from_ns"]

    def change(ticks: np.ndarray) -> np.ndarray:
        earlier = (ticks["t_ns"] < begins_ns) & (ticks["t_ns"] > begins_ns - 9e9)
        ticks["plan_point"][earlier] = int(last["index"])
        return ticks

    path = change_recording(played.on, tmp_path / "changed.mcap", change)
    [sound, retaken] = (found(one, played.calibration).cycles[-1] for one in (played.on, path))
    assert retaken.duration_s == sound.duration_s
    assert retaken.energy_J == sound.energy_J


def test_a_picture_of_many_cycles_has_no_more_dots_than_a_page_can_hold() -> None:
    """A thousand cycles took 60 MB of it."""
    [cycle] = noisy(1, 1, 0.02).cycles
    for cycles, dots in ((1, cycle.series.t_s.size), (200, DOTS_MAX)):
        [axes] = over_plane([cycle] * cycles).axes
        [x] = [one.get_xdata() for one in axes.lines if one.get_label() == "measured"]
        assert len(x) == dots


@pytest.mark.parametrize(
    ("lost", "reason"),
    [("end", "6 s of it without ticks; play it again"), ("speed_rad_s", "ticks without torque")],
)
def test_a_cycle_of_which_a_part_is_missing_is_left_out(
    played: Played, tmp_path: Path, lost: str, reason: str
) -> None:
    """A cycle that was cut counted as a whole one in the means."""
    last = open_run(played.on).operating_points()[-1]

    def change(ticks: np.ndarray) -> np.ndarray:
        cycle = ticks["plan_point"] == int(last["index"])
        cut = cycle & (ticks["t_ns"] > int(last["t_end_ns"]) - 6e9)
        if lost == "end":
            return ticks[~cut]
        ticks[lost][cut] = np.nan
        return ticks

    result = found(change_recording(played.on, tmp_path / "cut.mcap", change), played.calibration)
    assert [one.cycle for one in result.cycles] == [1, 2]
    [left_out] = [one for one in result.findings if one.name == "points-left-out"]
    assert reason in left_out.meaning
