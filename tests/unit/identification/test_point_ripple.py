from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.identification.harmonics import (
    harmonics_table,
    lines_at,
    over_one_turn,
    synthesis,
)
from motord.identification.operating_points import prepare
from motord.identification.point_ripple import (
    highest_order,
    point_ripple,
    rms_error_percent,
    rms_errors,
    without_drift,
)
from motord.identification.resample import fill_gaps
from tests.unit.identification.synthetic_bench import Bench, Truth, motor


def test_rms_error_of_a_sine() -> None:
    torque_Nm = 3 + 0.3 * np.sin(np.linspace(0, 20 * np.pi, 1000, endpoint=False))
    assert rms_error_percent(torque_Nm, 6.0) == pytest.approx(100 * 0.3 / np.sqrt(2) / 6)


@given(st.lists(st.floats(-10, 10), min_size=2, max_size=50), st.floats(-5, 5))
def test_rms_error_does_not_see_the_mean(values: list[float], mean: float) -> None:
    torque_Nm = np.array(values)
    shifted = rms_error_percent(torque_Nm + mean, 6.0)
    assert shifted == pytest.approx(rms_error_percent(torque_Nm, 6.0), abs=1e-9)


def test_ticks_weigh_by_the_angle_they_cover() -> None:
    angle_rad = np.linspace(0, 2 * np.pi, 100_000, endpoint=False)
    over_angle = rms_error_percent(np.sin(angle_rad), 1.0)
    t_s = angle_rad - 0.4 * np.sin(angle_rad)  # slow where the sine is low
    even_s = np.linspace(0, 2 * np.pi, 5000, endpoint=False)
    at_ticks = np.interp(even_s, t_s, angle_rad)
    speed = 1 / (1 - 0.4 * np.cos(at_ticks))
    assert rms_error_percent(np.sin(at_ticks), 1.0, speed) == pytest.approx(over_angle, rel=1e-3)


def test_lines_and_table_are_inverse() -> None:
    order, amplitude, phase = np.array([3, 16]), np.array([0.2, 0.05]), np.array([0.4, -1.2])
    table = harmonics_table(order, amplitude, phase, 257)
    lines = -1j * amplitude * np.exp(1j * phase)
    assert np.allclose(synthesis(order, lines, 257), table)
    both = synthesis(order, np.column_stack([lines, 2 * lines]), 257)
    assert np.allclose(both, np.column_stack([table, 2 * table]))
    assert np.allclose(over_one_turn(lines_at(np.arange(257), table, 257, 20), 257), table)


@pytest.mark.parametrize("counts", [100, 101])
def test_harmonics_of_unevenly_visited_points(counts: int) -> None:
    rng = np.random.default_rng(3)
    lines = np.array([0.5, 1 + 2j, 0, -0.3j, 0.1])
    values = over_one_turn(lines, counts)
    count = rng.integers(0, counts, 400) ** 2 % counts
    found = lines_at(count, values[count], counts, 4)
    assert np.allclose(found, lines, atol=1e-8)


@pytest.mark.parametrize("gap", [3, 22, 90])
def test_what_a_gap_leaves_open_is_small(gap: int) -> None:
    counts, highest, samples = 4096, 400, 1000
    lines = np.zeros(highest + 1, complex)
    lines[[8, 16, 48, 96]] = 0.5, 0.08j, 0.33 * np.exp(0.3j), 0.06
    rng = np.random.default_rng(gap)
    count = np.delete(np.arange(samples) * counts // samples, np.arange(300, 300 + gap))
    values = over_one_turn(lines, counts)[count] + 0.03 * rng.standard_normal(count.size)
    found = lines_at(count, values, counts, highest)
    share = gap / samples
    assert np.abs(found[48]) == pytest.approx(0.33, rel=2 * share + 0.02)
    assert np.abs(found - lines).max() < 0.02 + 2 * share


def test_gaps_are_filled_round_the_zero_point() -> None:
    table = np.array([np.nan, 1.0, 2.0, np.nan, 4.0, np.nan])
    assert np.allclose(fill_gaps(table), [2.0, 1.0, 2.0, 3.0, 4.0, 3.0])


def test_drift_is_taken_out_and_orders_are_kept() -> None:
    bench = Bench(torque_noise_Nm=0.0, drift_Nm=0.0)
    samples = prepare(bench.point(2.0, 1.0, 8, 3), 4096)
    steady = without_drift(samples, samples.torque_Nm)
    drifting = without_drift(samples, samples.torque_Nm + 0.3 * samples.t_s)
    inner = slice(1000, -1000)
    assert np.abs(drifting - steady)[inner].max() < 0.01


@pytest.mark.parametrize("torque_Nm", [1.0, 5.0])
def test_measured_ripple_is_the_true_one(torque_Nm: float) -> None:
    bench = Bench(torque_noise_Nm=0.1, lag_s=0.0)
    ripple = point_ripple(
        prepare(bench.point(torque_Nm, 0.8, 16, 4), 4096), bench.motor, bench.sensor
    )
    true_percent = bench.true_rms_percent(torque_Nm, None)
    assert abs(ripple.rms_percent - true_percent) < 4 * ripple.stderr_percent + 0.01
    assert ripple.stderr_percent < 0.05
    assert ripple.raw_percent > true_percent
    line = ripple.line_Nm[47] * 1j  # order 48 of the cogging torque, cogging alone there
    assert abs(abs(ripple.line_Nm[95]) - 0.03) < 4 * ripple.noise_Nm[95]
    assert abs(line) > 0.05
    angle_rad = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    curve = ripple.torque_over(angle_rad)
    assert 100 * curve.std() / 6 == pytest.approx(ripple.rms_percent, rel=0.03)


def test_smooth_torque_measures_as_smooth_under_noise() -> None:
    """What noise would add in quadrature is not there on average, and the error says so."""
    smooth = Truth(alpha=(1.0, 1.0, 1.0), beta_A=(0.0, 0.0, 0.0), cogging={})
    bench = Bench(truth=smooth, torque_noise_Nm=0.1, lag_s=0.0)
    ripples = [
        point_ripple(prepare(bench.point(2.0, 1.0, 12, seed), 4096), bench.motor, bench.sensor)
        for seed in range(5)
    ]
    for ripple in ripples:
        assert ripple.rms_percent < 3 * ripple.stderr_percent
        assert ripple.raw_percent > 0.8
    assert np.mean([r.rms_percent for r in ripples]) < 0.2


def test_one_turn_only_and_slow_sampling() -> None:
    bench = Bench(rate_Hz=250)
    samples = prepare(bench.point(2.0, 1.0, 3, 1), 4096)
    one = replace(samples, turns=samples.turns[:1])
    ripple = point_ripple(one, bench.motor, bench.sensor)
    assert ripple.turns == 1
    assert ripple.order[-1] <= 100
    assert np.isnan(ripple.noise_Nm).all()  # not known from one turn, by no means none
    assert ripple.stderr_percent is None
    assert highest_order(samples, motor(counts=41), bench.sensor) == 20


def test_the_mount_limits_the_orders() -> None:
    bench = Bench(motor=motor(), rate_Hz=2000)
    samples = prepare(bench.point(2.0, 2.0, 4, 1), 4096)
    assert highest_order(samples, bench.motor, bench.sensor) == pytest.approx(245, abs=2)


def test_many_poles_have_their_main_order_looked_at() -> None:
    bench = Bench(motor=motor(108, 48), rate_Hz=4000)
    samples = prepare(bench.point(2.0, 0.5, 4, 1), 4096)
    assert highest_order(samples, bench.motor, bench.sensor) > 864


def test_rms_errors_by_set_point() -> None:
    bench = Bench(rate_Hz=500)
    samples = prepare(bench.point(2.0, 1.0, 4, 1), 4096)
    ripple = point_ripple(samples, bench.motor, bench.sensor)
    other = replace(ripple, rms_percent=ripple.rms_percent + 1)
    after = replace(ripple, compensate=3, rms_percent=0.1)
    errors = rms_errors([ripple, other, after])
    assert len(errors.points) == 1
    assert errors.points[0].before == pytest.approx(ripple.rms_percent + 0.5)
    assert errors.points[0].after == 0.1
    assert rms_errors([]).before is None
