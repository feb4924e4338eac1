import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from motord.calibration import load as load_calibration
from motord.cli.analysis_command import app as analyse
from motord.config import load, packaged
from motord.experiments.captures_left_out import EveryCapture
from motord.experiments.hold_timing import phase_hold
from motord.experiments.ripple import estimate
from motord.experiments.ripple.command import estimate as estimate_verify
from motord.experiments.ripple_findings import findings
from motord.experiments.subject import Recordings, Subject
from motord.identification.disturbances import lines_of_points
from motord.identification.operating_points import CURRENTS, Samples
from motord.identification.point_ripple import AsynchronousLine, PointRipple, repeating_rms
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from tests.support.wrong_signals import change_recording, scaled
from tests.unit.experiments.conftest import Recorded
from tests.unit.experiments.test_cli import run


@pytest.fixture(scope="module")
def on(recorded: Recorded) -> list[PointRipple]:
    """Ripple of the points with compensation."""
    return estimate.ripples([open_run(recorded.on)], Subject.of_config(load()), EveryCapture())


@pytest.fixture(scope="module")
def off(recorded: Recorded) -> list[PointRipple]:
    return estimate.ripples([open_run(recorded.off)], Subject.of_config(load()), EveryCapture())


def explained(recorded: Recorded, path: Path) -> list:
    calibration = load_calibration(recorded.calibration)
    return estimate.explained(
        [open_run(path)], Subject.of_config(load()), calibration, EveryCapture()
    )


def with_bench_file(recorded: Recorded, path: Path, old: str, new: str) -> Path:
    """Return a copy of the compensated recording whose bench file says something else."""
    run_ = open_run(recorded.on)
    config = run_.metadata["config"]
    assert old in config
    with RunWriter(path, {**run_.metadata, "config": config.replace(old, new)}) as writer:
        writer.ticks(run_.ticks())
        for point in run_.operating_points():
            writer.operating_point(int(point["t_end_ns"]), point)
    return path


@pytest.mark.usefixtures("no_search_for_lines")
def test_images_of_held_currents_are_not_at_the_orders_of_the_slots(
    recorded: Recorded, tmp_path: Path
) -> None:
    subject = Subject.of_config(load())
    path = with_bench_file(recorded, tmp_path / "untimed.mcap", "lag_s", "# lag_s")
    seen, held = (
        estimate.ripples([open_run(one)], subject, EveryCapture()) for one in (path, recorded.on)
    )
    for as_sampled, point in zip(seen, held, strict=True):
        slots = as_sampled.order == subject.motor.slots
        assert np.abs(point.line_Nm[slots]) < 0.5 * np.abs(as_sampled.line_Nm[slots])
        orders_Nm, _ = repeating_rms(point.even_odd_Nm, point.noise_Nm)
        orders_percent = 100 / subject.motor.rated_torque_Nm * orders_Nm
        assert point.rms_percent > 1.2 * orders_percent  # with the images
        assert point.raw_percent == as_sampled.raw_percent


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("lag_s", "# lag_s"),
        ("actuation_delay_s", "# actuation_delay_s"),
        ('driver = "sim"', 'driver = "can-dq"'),
    ],
)
def test_images_are_left_where_the_timing_of_phase_currents_is_not_known(
    recorded: Recorded, tmp_path: Path, old: str, new: str
) -> None:
    assert phase_hold(open_run(recorded.on)) is not None
    path = with_bench_file(recorded, tmp_path / "other.mcap", old, new)
    assert phase_hold(open_run(path)) is None


@pytest.mark.usefixtures("no_search_for_lines")
@pytest.mark.parametrize("rate_Hz", [500, 1500])
def test_images_are_left_where_samples_are_no_whole_number_of_the_periods_of_the_loop_apart(
    recorded: Recorded, tmp_path: Path, rate_Hz: int
) -> None:
    """As in an imported recording of another rate."""
    subject = Subject.of_config(load())
    changes = ("lag_s", "# lag_s"), ("rate_Hz = 1000", f"rate_Hz = {rate_Hz}")
    paths = [with_bench_file(recorded, tmp_path / f"{one[1]}.mcap", *one) for one in changes]
    seen, other = (estimate.ripples([open_run(one)], subject, EveryCapture()) for one in paths)
    assert [one.rms_percent for one in other] == [one.rms_percent for one in seen]


@pytest.mark.usefixtures("no_search_for_lines")
def test_the_currents_explain_the_ripple_without_compensation(recorded: Recorded) -> None:
    for point in explained(recorded, recorded.off):
        measured = point.measured.rms_percent
        assert point.reconstructed.rms_percent == pytest.approx(measured, rel=0.01)
        assert point.rest_percent < 0.03 * measured
        assert 0.999 < point.share_explained <= 1.0
        assert 0.2e-3 < point.current_age_s < 0.4e-3  # of a period of 1 ms


@pytest.mark.usefixtures("no_search_for_lines")
def test_what_is_left_is_separated_with_compensation(recorded: Recorded) -> None:
    for point in explained(recorded, recorded.on):
        assert point.reconstructed.rms_percent == pytest.approx(point.measured.rms_percent, rel=0.2)
        assert point.rest_percent < 0.7 * point.measured.rms_percent


def test_images_between_the_samples_are_not_explained(recorded: Recorded, tmp_path: Path) -> None:
    """Of the same samples, the share is the same where images are known and where they are not."""
    path = with_bench_file(recorded, tmp_path / "untimed.mcap", "lag_s", "# lag_s")
    for held, sampled in zip(
        explained(recorded, recorded.on), explained(recorded, path), strict=True
    ):
        assert held.measured.rms_percent != sampled.measured.rms_percent
        assert held.share_explained == sampled.share_explained
        assert sampled.sampled_percent == sampled.measured.rms_percent


@pytest.mark.usefixtures("no_pictures")
def test_verify_with_the_calibration_reports_the_shares(recorded: Recorded, tmp_path: Path) -> None:
    report, output = tmp_path / "v.html", tmp_path / "v.json"
    files = ("-o", output, "--report", report)
    chosen = ("--calibration", recorded.calibration)
    code, out, _ = run(analyse, "verify", recorded.off, recorded.on, *chosen, *files)
    assert code == 0
    on = [one for one in json.loads(output.read_text())["points"] if one["compensate"]]
    rest_percent = sum(one["rest_percent"] for one in on) / len(on)
    text = " ".join(out.split())
    assert "mean over the points with compensation, as sampled" in text
    assert f"not explained by them {rest_percent:.2f} %" in text
    assert "share_explained" in output.read_text()
    assert "Where the ripple comes from" in report.read_text()


def test_the_gain_of_the_torque_sensor_is_in_the_stated_errors(
    recorded: Recorded, tmp_path: Path
) -> None:
    """A gain at the limit that [accuracy] assumes; noise is much less at these points."""
    change = partial(scaled, ("torque_Nm",), 1.005)
    path = change_recording(recorded.off, tmp_path / "gain.mcap", change)
    of = {path: estimate_verify(Recordings.open([path])) for path in (recorded.off, path)}
    for true, point, noise in zip(
        of[recorded.off].points, of[path].points, of[path].ripples, strict=True
    ):
        off = point["rms_percent"] - true["rms_percent"]
        assert 1.96 * noise.stderr_percent < off < 1.96 * point["stderr_percent"]


@pytest.mark.usefixtures("no_search_for_lines")
def test_a_point_without_currents_is_left_out_of_what_currents_explain(
    recorded: Recorded, tmp_path: Path
) -> None:
    """It ended the analysis of all the others."""

    def without_currents(ticks: np.ndarray) -> np.ndarray:
        for name in CURRENTS:
            ticks[name][ticks["plan_point"] == 1] = np.nan
        return ticks

    path = change_recording(recorded.on, tmp_path / "on.mcap", without_currents)
    found = estimate_verify(Recordings.open([path]), recorded.calibration)
    assert len(found.explained) == len(found.ripples) == 3
    [left_out] = [one for one in found.findings if one.name == "points-left-out"]
    assert "i_a_A, i_b_A, i_c_A were not recorded" in left_out.meaning


def test_a_calibration_of_another_motor_is_refused(recorded: Recorded, tmp_path: Path) -> None:
    bench = tmp_path / "b.toml"
    text = packaged("sim.toml").read_text().replace("report.rig.toml", "package:report.rig.toml")
    bench.write_text(text.replace('serial = "sim-1"', 'serial = "other"'))
    chosen = ("--calibration", recorded.calibration, "-c", bench)
    code, _, err = run(analyse, "verify", recorded.off, *chosen)
    assert code == 1
    assert "another motor" in err


@pytest.mark.parametrize(
    ("rms_percent", "stderr_percent", "hidden"),
    [
        (0.0, 1.2, True),
        (0.3, 0.2, True),
        (0.3, 0.1, False),
        (0.02, 0.03, False),
        (0.5, None, False),
    ],
)
def test_an_rms_error_that_noise_hides_is_a_finding(
    on: list[PointRipple], rms_percent: float, stderr_percent: float | None, hidden: bool
) -> None:
    point = on[0]
    assert findings([point]) == ()
    seen = replace(point, rms_percent=rms_percent, noise_stderr_percent=stderr_percent)
    assert [one.name for one in findings([point, seen])] == ["noise-hides-ripple"] * hidden
    hum = replace(point, rms_percent=rms_percent, stderr_percent=stderr_percent)
    assert findings([point, hum]) == ()  # what is not of noise


@pytest.mark.parametrize(
    ("mean_part", "rms_percent", "seen"),
    [
        (0.75, 5.0, False), (0.65, 5.0, True), (-1.0, 5.0, True), (1000.0, 5000.0, True),
        (None, 99.0, False), (None, 101.0, True),
    ],
)  # fmt: skip
def test_a_torque_of_another_scale_is_a_finding(
    off: list[PointRipple], mean_part: float | None, rms_percent: float, seen: bool
) -> None:
    points = [
        replace(
            one,
            rms_percent=rms_percent,
            torque_Nm=sign * one.torque_Nm,
            mean_Nm=None if mean_part is None else mean_part * sign * one.torque_Nm,
        )
        for sign in (1, -1)
        for one in off
    ]
    assert ["torque-scale" in one.name for one in findings(points)] == [True] * seen


@pytest.mark.parametrize("amplitude_Nm", [0.015, 0.2])
def test_hum_that_is_not_locked_to_the_rotor_is_named_and_in_the_interval(
    recorded: Recorded, on: list[PointRipple], tmp_path: Path, amplitude_Nm: float
) -> None:
    """Of 50 Hz: at 0.8 turns/s it is half-way between orders, at 1 turn/s it is order 50."""

    def hum(ticks: np.ndarray) -> np.ndarray:
        ticks["torque_Nm"] += amplitude_Nm * np.sin(2e-9 * np.pi * 50 * ticks["t_ns"])
        return ticks

    subject = Subject.of_config(load())
    path = change_recording(recorded.on, tmp_path / "hum.mcap", hum)
    humming = estimate.ripples([open_run(path)], subject, EveryCapture())
    assert max(one.leakage_percent for one in on) < 0.02  # what rings in the sensor
    outside = 0
    for before, after in zip(on, humming, strict=True):
        assert after.asynchronous_lines[0].frequency_Hz == pytest.approx(50, abs=0.05)
        off = abs(after.rms_percent - before.rms_percent)
        assert off < 1.96 * after.stderr_percent
        assert after.noise_stderr_percent < after.stderr_percent
        outside += off > 1.96 * after.noise_stderr_percent
    assert outside > 0  # without what is known of the line
    [found] = [one for one in findings(humming) if one.name == "asynchronous-line"]
    assert " 50.0 Hz " in found.meaning
    assert "mains" in found.action
    assert found.severity == ("serious" if amplitude_Nm == 0.2 else "warning")  # 0.18 % RMS
    assert found.value == pytest.approx(100 * amplitude_Nm / subject.motor.rated_torque_Nm, rel=0.2)
    assert "asynchronous-line" not in {one.name for one in findings(on)}


@pytest.mark.parametrize(
    ("leakage_percent", "bias_percent", "severity"),
    [(0.01, 0.0, "note"), (0.2, 0.01, "warning"), (0.3, 0.15, "serious"), (0.3, 0.25, "serious")],
)
def test_what_a_line_is_worth(
    on: list[PointRipple], leakage_percent: float, bias_percent: float, severity: str
) -> None:
    """A bias is 0.3 of the RMS error where the line is as large as the ripple."""
    seen = replace(
        on[0],
        rms_percent=0.5,
        noise_stderr_percent=0.1,
        stderr_percent=float(np.hypot(0.1, leakage_percent / 2**0.5)),
        leakage_percent=leakage_percent,
        bias_percent=bias_percent,
        asynchronous_percent=0.5,
        asynchronous_lines=(AsynchronousLine(50.0, 0.03, 0.001),),
    )
    [found] = findings([seen])
    assert found.severity == severity
    assert ("is as large as the ripple" in found.meaning) == (severity == "serious")
    assert "is not known" not in found.meaning
    near = replace(seen, asynchronous_lines=(AsynchronousLine(50.0, 0.03, 0.001, False),))
    [found] = findings([near])
    assert found.severity == severity
    assert "of an amplitude that is not known" in found.meaning
    assert ("may be as large as the ripple" in found.meaning) == (severity == "serious")
    assert "is as large as" not in found.meaning


@pytest.mark.parametrize(
    ("at_Hz", "speeds_Hz", "said", "advised"),
    [
        (
            lambda speed_Hz: 7.31 * abs(speed_Hz), speeds_Hz,
            "a line at 7.31 orders, at all speeds,",
            "a belt",
        )
        for speeds_Hz in ((0.6, 0.8, 1.0), (-0.6, -0.8, 1.0))
    ] + [
        (lambda speed_Hz: 50 + 0.01 * speed_Hz, (0.6, 0.8, 1.0), "a line at 50.0 Hz", "mains hum"),
        (lambda speed_Hz: 1234.5, (0.6, 0.8, 1.0), "a line at 1234.5 Hz", "mains hum"),
        (lambda speed_Hz: 50 + speed_Hz, (0.0, 1.0), "a line at 50.0, 51.0 Hz", "mains hum"),
    ],
)  # fmt: skip
def test_a_line_is_named_by_what_is_constant(
    on: list[PointRipple], at_Hz: Callable[[float], float], speeds_Hz: tuple[float, ...], said: str,
    advised: str,
) -> None:  # fmt: skip
    points = [
        replace(
            on[0],
            speed_Hz=speed_Hz,
            asynchronous_percent=0.5,
            asynchronous_lines=(AsynchronousLine(at_Hz(speed_Hz), 0.03, 0.001),),
        )
        for speed_Hz in speeds_Hz
    ]
    [found] = findings(points)
    assert said in found.meaning
    assert advised in found.action


def test_lines_of_other_points_that_count(
    recorded: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 50 Hz at the torque where another speed shows it; of a belt at none."""
    subject, run_ = Subject.of_config(load()), open_run(recorded.on)
    speeds_Hz: dict[tuple[float, float], float] = {}

    def none(samples: Samples, _: int) -> tuple[AsynchronousLine, ...]:
        speeds_Hz[samples.torque_set_Nm, samples.speed_set_Hz] = samples.speed_Hz
        return ()

    monkeypatch.setattr(lines_of_points, "asynchronous_lines", none)
    estimate.ripples([run_], subject, EveryCapture())
    first, fastest = min(torque for torque, _ in speeds_Hz), max(speed for _, speed in speeds_Hz)
    assert len({torque for torque, _ in speeds_Hz}) == len({speed for _, speed in speeds_Hz}) == 2

    def hum(samples: Samples, _: int) -> tuple[AsynchronousLine, ...]:
        shows = samples.torque_set_Nm == first and samples.speed_set_Hz != fastest
        return (AsynchronousLine(50 * speeds_Hz[first, fastest], 0.03, 0.001),) * shows

    monkeypatch.setattr(lines_of_points, "asynchronous_lines", hum)
    for one in estimate.ripples([run_], subject, EveryCapture()):
        assert bool(one.asynchronous_lines) == (one.torque_Nm == first)

    def belt(samples: Samples, _: int) -> tuple[AsynchronousLine, ...]:
        return (AsynchronousLine(7.5 * samples.speed_Hz, 0.03, 0.001),)

    monkeypatch.setattr(lines_of_points, "asynchronous_lines", belt)
    for one in estimate.ripples([run_], subject, EveryCapture()):
        [line] = one.asynchronous_lines
        assert line.frequency_Hz == pytest.approx(7.5 * one.speed_Hz, rel=0.01)
