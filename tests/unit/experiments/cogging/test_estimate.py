"""Cogging torque of driven rotors against the truth, over motors, encoders and sensors."""

from dataclasses import replace
from itertools import product
from math import lcm

import numpy as np
import pytest
from scipy.signal import lfilter

from motord.calibration import CalibratedMotor
from motord.config import MotorConfig, TorqueSensorConfig
from motord.experiments.cogging.at_speed import _noise
from motord.experiments.cogging.estimate import compare, measure
from motord.experiments.cogging.report import _comparison
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData
from motord.intervals import coverage_factor
from motord.report.html import Page
from tests.campaigns.cogging import errors, measured, true_line
from tests.campaigns.driven import MOTORS, REPORT, Motor
from tests.unit.identification import synthetic_bench as synthetic
from tests.unit.test_calibration import make


def driven(bench: synthetic.Bench, *speeds_Hz: float, turns: float = 9.3) -> list[PointData]:
    """Points of a rotor without current; the currents were not recorded."""
    points = []
    for row, speed_Hz in enumerate(speeds_Hz):
        point = bench.point(0.0, speed_Hz, turns, seed=row + 3)
        columns = ["t_ns", "encoder_count", "torque_Nm"]
        points.append(replace(point, ticks=point.ticks[columns].copy()))
    return points


def no_current(**changes: object) -> synthetic.Truth:
    return synthetic.Truth(alpha=(1.0, 1.0, 1.0), beta_A=(0.0, 0.0, 0.0), **changes)


def test_the_simulated_rig_is_measured_in_spite_of_belt_and_sensor() -> None:
    found, truth = measured(REPORT, 1, speeds_Hz=(0.5, 1.0))
    magnitude_percent, phase_points, time_percent, z = errors(found, truth)
    assert magnitude_percent < 0.8  # two of the six speeds
    assert phase_points < 0.2
    assert time_percent < 0.5
    assert found.speeds[0].speed_ripple > 0.1
    assert np.sqrt((z**2).mean()) == pytest.approx(1.0, abs=0.6)
    assert found.main_order == 48
    assert np.abs(found.error_percent(found.speeds[0])).max() < 1.0


@pytest.mark.parametrize("motor", MOTORS, ids=lambda motor: motor.name)
def test_any_motor(motor: Motor) -> None:
    found, truth = measured(motor, 2, speeds_Hz=(0.87, 1.13), turns=9)
    main = lcm(motor.slots, motor.poles)
    assert found.main_order == main
    assert found.order[np.argmax(found.amplitude_Nm)] == main
    assert {motor.slots, motor.poles, main} <= set(found.order[found.allowed].tolist())
    for h in truth.motor.cogging:
        place = int(np.flatnonzero(found.order == h.order)[0])
        off_Nm = abs(found.line_Nm[place] - true_line(truth, h.order))
        assert off_Nm < 5 * found.stderr_Nm[place] + 1e-4
        assert found.stderr_Nm[place] < 1.5e-3


@pytest.mark.parametrize(("counts", "highpass_s"), [(1000, 0.0), (2001, 0.5), (20_000, 0.5)])
def test_any_encoder_and_a_sensor_that_passes_the_mean(counts: int, highpass_s: float) -> None:
    sensor = TorqueSensorConfig(highpass_time_constant_s=highpass_s)
    bench = synthetic.Bench(
        motor=synthetic.motor(counts=counts),
        truth=no_current(),
        sensor=sensor,
        torque_noise_Nm=0.02,
    )
    found = measure(driven(bench, 0.5, 0.8), bench.motor, sensor)
    for order, (amplitude_Nm, phase_rad) in bench.truth.cogging.items():
        place = int(np.flatnonzero(found.order == order)[0])
        assert found.amplitude_Nm[place] == pytest.approx(amplitude_Nm, abs=1.2e-3)
        assert found.phase_rad[place] == pytest.approx(phase_rad, abs=0.03)


def test_a_rotor_that_turns_backward_has_the_same_cogging_torque() -> None:
    bench = synthetic.Bench(truth=no_current(), torque_noise_Nm=0.01)
    forward = driven(bench, 0.7)
    backward = []
    for point in forward:
        ticks = point.ticks[::-1].copy()
        ticks["t_ns"] = point.ticks["t_ns"]
        backward.append(replace(point, ticks=ticks))
    rigid = TorqueSensorConfig()
    there = measure(forward, bench.motor, rigid)
    back = measure(backward, bench.motor, rigid)
    assert np.abs(there.line_Nm - back.line_Nm).max() < 1e-4


def test_an_order_that_nothing_explains_is_reported_and_not_part_of_the_torque() -> None:
    cogging = {48: (0.1, 0.2), 7: (0.05, 0.4)}
    bench = synthetic.Bench(truth=no_current(cogging=cogging), torque_noise_Nm=0.02)
    found = measure(driven(bench, 0.5, 0.8), bench.motor, bench.sensor)
    assert found.order[~found.allowed].tolist() == [7]
    place = int(np.flatnonzero(found.order == 7)[0])
    assert found.amplitude_Nm[place] == pytest.approx(0.05, abs=2e-3)
    assert found.peak_Nm == pytest.approx(0.1, abs=5e-3)


@pytest.mark.parametrize(
    ("off_deg", "times", "both", "severity"),
    [
        (0.0, 1, False, None), (0.1, 1, False, "note"), (0.1, 1, True, "serious"),
        (0.3, 1, False, "serious"), (0.5, 1, False, "serious"), (0.3, 2, False, "serious"),
        (0.1, 2, True, "serious"),
    ],
)  # fmt: skip
def test_what_an_encoder_that_is_off_takes_off_the_orders_is_in_the_interval(
    off_deg: float, times: int, both: bool, severity: str | None
) -> None:
    """Once a turn by an eccentric disc, twice a turn by an oval one."""
    cogging = {48: (0.06, 0.4), 16: (0.02, 1.0)}
    bench = synthetic.Bench(
        truth=no_current(cogging=cogging), sensor=TorqueSensorConfig(), torque_noise_Nm=0.02
    )
    counts = bench.motor.counts
    points = []
    for point, step in product(driven(bench, 0.53, 0.87), (1, -1) if both else (1,)):
        ticks = point.ticks[::step].copy()
        ticks["t_ns"] = point.ticks["t_ns"]
        angle_rad = ticks["encoder_count"] * (2 * np.pi / counts)
        bent_rad = np.radians(off_deg) * np.sin(times * angle_rad + 0.7)
        moved = np.rint(ticks["encoder_count"] + bent_rad * counts / (2 * np.pi))
        ticks["encoder_count"] = moved.astype(int) % counts
        points.append(replace(point, ticks=ticks))
    found = measure(points, bench.motor, bench.sensor)
    encoder = {one.name: one for one in found.findings if one.name.startswith("encoder-error")}
    named = encoder.pop(f"encoder-error-order-{times}", None)
    assert (named.severity if named else None) == severity
    assert not encoder
    if named:
        assert named.value == pytest.approx(off_deg, rel=0.1)
        assert "order 48 by" in named.meaning
    for harmonic in found.harmonics:
        if harmonic.order in cogging:
            off_Nm = harmonic.amplitude_Nm - cogging[harmonic.order][0]
            assert abs(off_Nm) < 1.3 * harmonic.half_width_Nm  # four trials of two orders
            assert harmonic.half_width_Nm < 4e-3


def test_noise_of_an_order_is_the_median_of_its_neighbours_that_are_not_fitted() -> None:
    rng = np.random.default_rng(2)
    lines_Nm = rng.standard_normal((2, 120)) * np.linspace(1.0, 3.0, 120)
    spectrum_Nm, fitted = lines_Nm[0] + 1j * lines_Nm[1], np.array([1, 48, 50])
    size_Nm = np.abs(spectrum_Nm)
    size_Nm[fitted - 1] = np.nan
    near_Nm = [size_Nm[max(place - 20, 0) : place + 21] for place in range(120)]
    level_Nm = [np.nanmedian(near) / 1.177 for near in near_Nm]
    assert _noise(spectrum_Nm, fitted) == pytest.approx(level_Nm, rel=1e-12)
    assert (_noise(spectrum_Nm, np.arange(1, 121)) < 1e-290).all()


def test_coloured_noise_is_in_the_errors_of_few_turns() -> None:
    """12 trials of 5 turns at two speeds; a torsional resonance (Q = 50) near order 48."""
    held = []
    for seed in range(12):
        bench = synthetic.Bench(
            truth=no_current(cogging={48: (0.06, 0.4)}), sensor=TorqueSensorConfig(),
            torque_noise_Nm=0.005, fine_Hz=1000,
        )  # fmt: skip
        points = []
        for row, speed_Hz in enumerate((0.53, 0.87)):
            point = bench.point(0.0, speed_Hz, 5.4, seed=10 * seed + row)
            ticks = point.ticks[["t_ns", "encoder_count", "torque_Nm"]].copy()
            resonance_Hz, noise = 48.5 * speed_Hz, np.random.default_rng([seed, row])
            pole = np.exp(2e-3 * np.pi * resonance_Hz * (1j - 0.01))
            white = noise.standard_normal(ticks.size + 2000)
            rings = lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], white)[2000:]
            ticks["torque_Nm"] += 0.018 * rings / rings.std()
            points.append(replace(point, ticks=ticks))
        found = measure(points, bench.motor, bench.sensor)
        for one in found.speeds:
            assert one.turns < 6
            place = one.order.tolist().index(48)
            off_Nm = abs(abs(one.line_Nm[place]) - 0.06)
            held.append(off_Nm < coverage_factor(one.turns - 1) * one.stderr_Nm[place])
    assert np.mean(held) >= 0.86  # 95 % less two standard errors of 24


def test_a_torque_that_changes_over_the_turn_is_no_encoder_error() -> None:
    """An amplitude that is modulated has sidebands of the same sign, and the order is as stated."""
    cogging = {48: (0.06, 0.4), **dict.fromkeys((46, 47, 49, 50), (0.004, 0.4))}
    bench = synthetic.Bench(truth=no_current(cogging=cogging), torque_noise_Nm=0.02)
    found = measure(driven(bench, 0.5, 0.8), bench.motor, bench.sensor)
    assert not any(one.name.startswith("encoder-error") for one in found.findings)


def test_a_run_without_points_is_cut_into_steady_stretches() -> None:
    bench = synthetic.Bench(truth=no_current(), torque_noise_Nm=0.02)
    slow, fast = driven(bench, 0.5, 0.9, turns=5.4)
    ticks = np.concatenate([slow.ticks, fast.ticks])
    ticks["t_ns"][slow.ticks.size :] += slow.ticks["t_ns"][-1]
    found = measure([PointData(0.0, 0.0, ticks)], bench.motor, bench.sensor)
    assert [round(one.speed_Hz, 1) for one in found.speeds] == [0.5, 0.9]
    assert found.order[np.argmax(found.amplitude_Nm)] in (16, 48)


def test_a_single_turn_is_better_than_nothing() -> None:
    bench = synthetic.Bench(truth=no_current(), torque_noise_Nm=0.01)
    ticks = driven(bench, 0.5, turns=1.4)[0].ticks
    found = measure([PointData(0.0, 0.0, ticks)], bench.motor, bench.sensor)
    assert found.speeds[0].turns == 1
    assert found.order[np.argmax(found.amplitude_Nm)] in (16, 48)


def test_what_cannot_be_identified_is_refused() -> None:
    bench = synthetic.Bench(truth=no_current())
    motor, sensor = bench.motor, bench.sensor
    point = driven(bench, 0.7)[0]
    with pytest.raises(IdentifyError, match="no good operating point"):
        measure([], motor, sensor)
    short = replace(point, ticks=point.ticks[:900])
    with pytest.raises(IdentifyError, match=r"driven at 0\.7 Hz: no whole turn"):
        measure([short], motor, sensor)
    without = replace(point, ticks=point.ticks[["t_ns", "encoder_count"]])
    with pytest.raises(IdentifyError, match="the recording has no torque_Nm: no measured torque"):
        measure([without], motor, sensor)
    zeros = point.ticks.copy()
    zeros["torque_Nm"] = np.nan
    with pytest.raises(IdentifyError, match="nothing was recorded in torque_Nm"):
        measure([replace(point, ticks=zeros)], motor, sensor)
    coarse = replace(point, ticks=point.ticks[::300].copy())
    with pytest.raises(IdentifyError, match="fewer than 8 samples in a turn"):
        measure([coarse], motor, sensor)
    seldom = replace(point, ticks=point.ticks[::50].copy())
    with pytest.raises(IdentifyError, match="48 slots and 16 poles have none below 16"):
        measure([seldom], motor, sensor)
    loaded = bench.point(2.0, 0.7, 6, seed=1)
    with pytest.raises(IdentifyError, match="A turn with the rotor in i_a_A: this needs a run"):
        measure([loaded], motor, sensor)


def test_currents_that_only_have_an_offset_do_not_flow() -> None:
    bench = synthetic.Bench(truth=synthetic.Truth(alpha=(1.0, 1.0, 1.0), beta_A=(0.0, 0.0, 0.0)))
    point = bench.point(0.0, 0.7, 6, seed=1)
    point.ticks["i_a_A"] += 1.25
    assert measure([point], bench.motor, bench.sensor).speeds[0].turns >= 4


def test_comparison_with_a_calibration() -> None:
    bench = synthetic.Bench(truth=no_current(cogging={48: (0.1, 0.2), 16: (0.05, 1.0)}))
    found = measure(driven(bench, 0.5, 0.8), bench.motor, bench.sensor)
    motor: MotorConfig = bench.motor
    angle_rad = 2 * np.pi * np.arange(motor.counts) / motor.counts
    late_rad = 0.3 * 2 * np.pi / motor.counts
    tau_Nm = 1.01 * 0.1 * np.sin(48 * angle_rad + 0.2)
    tau_Nm = tau_Nm + 0.05 * np.sin(16 * (angle_rad + late_rad) + 1.0)
    calibration = make(motor=CalibratedMotor.of(motor), tau_cog_Nm=tuple(tau_Nm))
    comparison = compare(found, calibration)
    assert comparison.order.tolist() == [16, 48]
    assert comparison.magnitude_percent == pytest.approx([0.0, 1.0], abs=3.0)
    assert comparison.phase_points[0] == pytest.approx(0.3, abs=2.0)
    assert 0.2 < comparison.worst_percent < 3.0

    none = np.empty(0)
    unseen = replace(comparison, order=none, magnitude_percent=none, phase_points=none)
    for shown, rows in ((comparison, 3), (unseen, 1)):
        page = Page("made up", "")
        _comparison(page, found, shown)
        compared = page.html().partition("Poels 2008</th>")[2].partition("</table>")[0]
        assert compared.count("<tr>") == rows
        assert "nan" not in compared
