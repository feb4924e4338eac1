"""The estimators against a bench whose truth is known exactly."""

from dataclasses import replace
from datetime import UTC, datetime
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.config import TorqueSensorConfig
from motord.experiments.calibration.estimate.calibrator import (
    Calibrator,
)
from motord.experiments.calibration.estimate.residual import ResidualEstimator, Trial
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.identification import IdentifyError
from tests.support.properties import examples
from tests.support.virtual_calibration import calibrate
from tests.unit.identification.synthetic_bench import Bench, Truth, motor


def gauged(alpha: tuple[float, ...]) -> np.ndarray:
    return np.array(alpha) / np.cbrt(np.prod(alpha))


def check(bench: Bench, result: CalibrationResult, alpha_error: float, beta_error_A: float) -> None:
    assert np.abs(result.alpha / gauged(bench.truth.alpha) - 1).max() < alpha_error
    assert np.abs(result.beta_A - bench.truth.beta_A).max() < beta_error_A
    found = {h.order: h for h in result.harmonics}
    for order, (amplitude_Nm, phase) in bench.truth.cogging.items():
        error = found[order].amplitude_Nm * np.exp(1j * found[order].phase_rad)
        error -= amplitude_Nm * np.exp(1j * phase)
        assert abs(error) < 4 * found[order].stderr_Nm + 5e-4
    calibration = result.to_calibration(bench.motor, datetime.now(UTC), ["a.mcap"])
    for torque_Nm in (1.0, 3.0, 5.0):
        assert bench.true_rms_percent(torque_Nm, None) > 3.0
        assert bench.true_rms_percent(torque_Nm, calibration) < 0.15


@cache
def plain(connection: str, third: float) -> tuple[Bench, CalibrationResult]:
    """Return a bench with what is found on it."""
    bench = Bench(motor=motor(connection=connection, third=third))
    return bench, calibrate(bench.mesh(turns=10), bench.motor, bench.sensor)


@pytest.mark.parametrize("connection", ["independent", "star"])
@pytest.mark.parametrize("third", [0.0, 0.08])
def test_truth_is_found(connection: str, third: float) -> None:
    bench, result = plain(connection, third)
    check(bench, result, 0.003, 0.025)
    text = " ".join(result.observable)
    assert ("offset of the currents: measured" in text) == (third > 0 or connection == "star")
    assert ("Kirchhoff" in text) == (connection == "star")
    assert 1 < result.condition_number < 200


@pytest.mark.parametrize(
    ("slots", "pole_pairs", "counts", "orders"),
    [
        (12, 5, 1000, {10: 0.05, 12: 0.02, 60: 0.1}),
        (36, 6, 2001, {12: 0.06, 36: 0.1}),
        (18, 12, 20_000, {24: 0.04, 72: 0.08}),
        (9, 4, 1023, {8: 0.05, 72: 0.1}),
    ],
)
def test_any_motor(slots: int, pole_pairs: int, counts: int, orders: dict[int, float]) -> None:
    cogging = {order: (amplitude, 0.4) for order, amplitude in orders.items()}
    bench = Bench(
        motor=motor(slots, pole_pairs, counts),
        truth=Truth(cogging=cogging),
        ripple_order=pole_pairs,
    )
    result = calibrate(bench.mesh(turns=10), bench.motor, bench.sensor)
    check(bench, result, 0.004, 0.02)


def test_odd_sampling_backwards_and_late_currents() -> None:
    bench = Bench(rate_Hz=1250, i_age_s=0.8e-3, speed_ripple=0.15)
    mesh = bench.mesh(turns=10)
    check(bench, calibrate(mesh, bench.motor, bench.sensor), 0.003, 0.02)


def test_currents_of_unknown_age_are_aligned_by_the_torque() -> None:
    bench = Bench(i_age_s=0.5e-3)
    mesh = bench.mesh(torques_Nm=(1.0, 5.0), turns=12)
    for point in mesh:
        point.ticks["i_age_ns"] = 0  # the recording says nothing of their age
    result = calibrate(mesh, bench.motor, bench.sensor)
    assert result.current_delay_s is not None
    delay_s, stderr_s, _ = result.current_delay_s
    assert abs(delay_s - 0.5e-3) < 4 * stderr_s + 0.05e-3
    assert np.abs(result.alpha / gauged(bench.truth.alpha) - 1).max() < 0.004


def test_noisy_current_sensors_do_not_pull_alpha_towards_one() -> None:
    bench = Bench(current_noise_A=1.0, torque_noise_Nm=0.02)
    mesh = bench.mesh(turns=12)
    result = calibrate(mesh, bench.motor, bench.sensor)
    assert np.abs(result.alpha / gauged(bench.truth.alpha) - 1).max() < 0.01
    without = [
        replace(p, ticks=p.ticks[[n for n in p.ticks.dtype.names if "cmd" not in n]]) for p in mesh
    ]
    averaged = calibrate(without, bench.motor, bench.sensor)
    assert np.abs(averaged.alpha / gauged(bench.truth.alpha) - 1).max() < 0.02


def test_a_rigid_sensor_that_passes_the_mean() -> None:
    bench = Bench(sensor=TorqueSensorConfig(), drift_Nm=0.0)
    check(bench, calibrate(bench.mesh(turns=10), bench.motor, bench.sensor), 0.003, 0.02)


def test_a_compensated_run_gives_the_same_calibration() -> None:
    bench, first = plain("independent", 0.0)
    calibration = first.to_calibration(bench.motor, datetime.now(UTC), [])
    again = calibrate(
        bench.mesh(turns=10, seed=2, calibration=calibration), bench.motor, bench.sensor
    )
    assert np.abs(again.alpha - first.alpha).max() < 0.005
    assert np.abs(again.beta_A - first.beta_A).max() < 0.02


def test_the_residual_estimator_is_biased_and_the_joint_one_is_not() -> None:
    """The demonstration of METHODS: 23 turns, cogging of order 16, noise of 0.15 Nm."""
    truth = Truth(cogging={16: (0.08, 0.3)})
    bench = Bench(truth=truth, torque_noise_Nm=0.15)
    calibrator = Calibrator(bench.motor, bench.sensor)
    for point in bench.mesh(torques_Nm=(1.0, 3.0, 5.0), speeds_Hz=(0.7,), turns=24):
        calibrator.add(point)
    joint, residual = calibrator.joint(), calibrator.residual()
    bias = np.abs(residual.alpha / np.array(truth.alpha) - 1)
    assert 0.02 < bias.max() < 0.1
    assert np.abs(joint.alpha / gauged(truth.alpha) - 1).max() < 0.003
    assert residual.method == "residual"
    # some of the cogging torque went into alpha, so less of it is left
    left = {h.order: h.amplitude_Nm for h in residual.harmonics}[16]
    assert left < 0.06


def test_the_residual_estimator_is_the_pseudo_inverse_of_the_stacked_matrix() -> None:
    bench = Bench(motor=motor(counts=100, slots=12, pole_pairs=5), rate_Hz=500)
    mesh = bench.mesh(turns=6)
    result = calibrate(mesh, bench.motor, bench.sensor, "residual")
    k = bench.motor.back_emf_table()
    stacked_x, stacked_tau = [], []
    from motord.identification.operating_points import prepare

    for point in mesh:
        s = prepare(point, 100)
        chosen = [s.count[s.whole] == n for n in range(100)]
        i_A = np.array([s.i_A[s.whole][c].mean(axis=0) for c in chosen])
        tau = np.array([s.torque_Nm[s.whole][c].mean() for c in chosen])
        stacked_x.append(np.column_stack([i_A * k, k]))
        stacked_tau.append(tau - tau.mean())
    y = np.linalg.pinv(np.concatenate(stacked_x), rcond=1e-9) @ np.concatenate(stacked_tau)
    assert np.allclose(result.alpha, 1 + y[:3], atol=1e-6)
    assert np.allclose(result.beta_A, y[3:], atol=1e-6)
    z = np.mean([t - x @ y for x, t in zip(stacked_x, stacked_tau, strict=True)], axis=0)
    assert np.allclose(result.tau_cog_Nm, z - z.mean(), atol=1e-6)


def test_order_of_points_does_not_matter() -> None:
    bench = Bench(rate_Hz=500, sensor=TorqueSensorConfig(highpass_time_constant_s=2.0))
    mesh = bench.mesh(turns=6)
    one = calibrate(mesh, bench.motor, bench.sensor)
    other = calibrate(mesh[::-1], bench.motor, bench.sensor)
    assert np.allclose(one.alpha, other.alpha, atol=1e-7)
    assert np.allclose(one.tau_cog_Nm, other.tau_cog_Nm, atol=1e-7)


def test_many_points_take_errors_between_points_into_account() -> None:
    bench = Bench(rate_Hz=500, sensor=TorqueSensorConfig(highpass_time_constant_s=2.0))
    mesh = bench.mesh(torques_Nm=(1.0, 3.0, 5.0), speeds_Hz=(0.6, 0.9), turns=5)
    result = calibrate(mesh, bench.motor, bench.sensor)
    assert (result.alpha_stderr > 0).all()
    assert (result.alpha_stderr < 0.005).all()
    assert len(result.ripples) == 6


@pytest.mark.parametrize("connection", ["independent", "star"])
def test_standard_errors_are_true(connection: str) -> None:
    """The truth lies within the 95 % intervals of 30 small trials about 95 times in a hundred."""
    bench = Bench(
        motor=motor(counts=400, connection=connection),
        rate_Hz=500,
        fine_Hz=2000,
        sensor=TorqueSensorConfig(highpass_time_constant_s=2.0),
    )
    truth = np.concatenate([gauged(bench.truth.alpha), bench.truth.beta_A])
    misses, numbers = 0, 0
    for seed in range(1, 31):
        result = calibrate(bench.mesh(turns=6, seed=seed), bench.motor, bench.sensor)
        found = np.concatenate([result.alpha, result.beta_A])
        assert result.alpha_half_width is not None
        assert result.beta_half_width_A is not None
        half_width = np.concatenate([result.alpha_half_width, result.beta_half_width_A])
        misses += int((np.abs(found - truth) > half_width).sum())
        for harmonic in result.harmonics:
            amplitude_Nm, _ = bench.truth.cogging.get(harmonic.order, (0.0, 0.0))
            if amplitude_Nm:
                error_Nm = abs(harmonic.amplitude_Nm - amplitude_Nm)
                misses += int(error_Nm > harmonic.half_width_Nm)
        numbers += 6 + len(bench.truth.cogging)
    assert 0.01 < misses / numbers < 0.10


def test_a_star_measures_the_common_gain() -> None:
    truth = Truth(delta=1.05)
    bench = Bench(motor=motor(connection="star"), truth=truth, torque_noise_Nm=0.02)
    result = calibrate(bench.mesh(turns=12), bench.motor, bench.sensor)
    assert result.delta_epsilon_stderr is not None
    assert abs(result.delta_epsilon - 1.05) < 4 * result.delta_epsilon_stderr
    assert result.delta_epsilon_stderr < 0.01
    assert np.abs(result.alpha - gauged(truth.alpha)).max() < 0.001
    assert "agrees with Kirchhoff's law" in " ".join(result.observable)
    assert result.findings == ()  # it is measured: alpha by torque and by law are compared with it
    calibration = result.to_calibration(bench.motor, datetime.now(UTC), ["star.mcap"])
    assert calibration.delta_epsilon_source == "star.mcap"


def test_orders_beyond_the_sampling_are_left_out_and_named() -> None:
    bench = Bench(rate_Hz=250, fine_Hz=2000)
    result = calibrate(bench.mesh(turns=10), bench.motor, bench.sensor)
    assert max(h.order for h in result.harmonics) == 96
    assert any("144, 192 are too high" in text for text in result.observable)


class TestNoZeroSequence:
    """A star whose drive reports its currents along d and q."""

    def bench(self, gain: float) -> Bench:
        other = gain**-0.5
        return Bench(
            motor=motor(counts=500, connection="star"),
            truth=Truth(alpha=(gain, other, other)),
            rate_Hz=500,
            fine_Hz=2000,
            sensor=TorqueSensorConfig(highpass_time_constant_s=2.0),
        )

    def calibrate(self, bench: Bench) -> CalibrationResult:
        mesh = bench.mesh(turns=6)
        names = [f"i_{p}_A" for p in "abc"]
        for point in mesh:
            common_A = sum(point.ticks[name] for name in names) / 3
            for name in names:
                point.ticks[name] -= common_A
        return calibrate(mesh, bench.motor, bench.sensor)

    def test_a_gain_at_the_edge_of_what_there_is(self) -> None:
        bench = self.bench(0.5)
        result = self.calibrate(bench)
        assert np.abs(result.alpha - gauged(bench.truth.alpha)).max() < 0.01

    def test_a_gain_that_comes_out_too_large_only_after_rounds(self) -> None:
        with pytest.raises(IdentifyError, match=r"phase a comes out with a gain of 2\.|not settle"):
            self.calibrate(self.bench(2.2))


@pytest.mark.parametrize("orders", [{48: (0.15, 0.4)}, {48: (0.15, 0.4), 7: (0.05, 1.0)}])
def test_a_point_of_a_single_turn_is_left_out_with_a_note(
    orders: dict[int, tuple[float, float]],
) -> None:
    bench = Bench(truth=Truth(cogging=orders), rate_Hz=2500)
    mesh = bench.mesh(turns=6)
    without = calibrate(mesh, bench.motor, bench.sensor)
    found = calibrate([bench.point(2.0, 0.8, 2.1, 5), *mesh], bench.motor, bench.sensor)
    assert (7 in {line.order for line in found.harmonics}) == (7 in orders)
    assert np.array_equal(found.alpha, without.alpha)
    assert np.array_equal(found.beta_A, without.beta_A)
    note = "left out, as they have fewer than 2 whole turns: 2 Nm, 0.8 Hz (set turns to 3 or more)"
    assert note in found.observable
    assert note not in without.observable


class TestRefusals:
    bench = Bench(
        rate_Hz=500, fine_Hz=2000, sensor=TorqueSensorConfig(highpass_time_constant_s=2.0)
    )

    def refused(self, mesh: list, expected: str) -> None:
        with pytest.raises(IdentifyError, match=expected) as caught:
            calibrate(mesh, self.bench.motor, self.bench.sensor)
        assert "\n" not in str(caught.value)

    def test_nothing(self) -> None:
        self.refused([], "no good operating point")
        with pytest.raises(IdentifyError, match="no operating points"):
            calibrate([], self.bench.motor, self.bench.sensor, "residual")

    def test_one_torque(self) -> None:
        mesh = self.bench.mesh(torques_Nm=(3.0,), speeds_Hz=(0.6, 0.8), turns=8)
        self.refused(mesh, r"about the same torque \(3 to 3 Nm\).*add a torque")

    def test_too_few_turns(self) -> None:
        self.refused(self.bench.mesh(turns=2.1), "no good operating point of 2 whole turns.*to 3")
        self.refused(self.bench.mesh(speeds_Hz=(0.6,), turns=4), "whole turns in all: too few")

    def test_dead_phase(self) -> None:
        mesh = self.bench.mesh(turns=8)
        for point in mesh:
            point.ticks["i_b_A"] *= 0.01
        self.refused(mesh, "phase b is dead")

    def test_gains_that_no_sensor_has(self) -> None:
        mesh = self.bench.mesh(turns=8)
        for point in mesh:
            point.ticks["i_c_A"] *= 4
        self.refused(mesh, "phase c comes out with a gain of 0|no gains fit")

    def test_noise(self) -> None:
        mesh = replace(self.bench, torque_noise_Nm=20.0).mesh(turns=8)
        self.refused(mesh, "known to|comes out with a gain|no gains fit")


def test_rated_current_of_the_reports_motor() -> None:
    assert motor().rated_current_A() == pytest.approx(19.4, rel=0.05)
    assert motor(connection="star").rated_current_A() == pytest.approx(19.4, rel=0.05)


gain = st.floats(0.7, 1.4)
offset_A = st.floats(-2.0, 2.0)


@settings(max_examples=examples(50))
@given(
    alpha=st.tuples(gain, gain, gain),
    beta_A=st.tuples(offset_A, offset_A, offset_A),
    torque_Nm=st.floats(0.1, 6.0),
    connection=st.sampled_from(["independent", "star"]),
)
def test_compensation_inverts_the_model(
    alpha: tuple[float, float, float],
    beta_A: tuple[float, float, float],
    torque_Nm: float,
    connection: str,
) -> None:
    """With the true alpha, beta and cogging, the command makes an even torque, (4.1)."""
    truth = Truth(alpha=alpha, beta_A=beta_A)
    bench = Bench(motor=motor(connection=connection, third=0.05), truth=truth)
    table = truth.cogging_Nm(2 * np.pi * np.arange(4096) / 4096)

    class TrueModel:
        delta_epsilon = 1.0
        tau_cog_Nm = tuple(table)

    TrueModel.alpha, TrueModel.beta_A = alpha, beta_A
    assert bench.true_rms_percent(torque_Nm, TrueModel) < 0.01


def test_runs_with_and_without_compensation_together_measure_the_common_gain() -> None:
    truth = Truth(delta=1.04)
    bench = Bench(truth=truth, torque_noise_Nm=0.03)
    off = bench.mesh(turns=10)
    first = calibrate(off, bench.motor, bench.sensor)
    assert first.delta_epsilon_stderr is None
    calibration = first.to_calibration(bench.motor, datetime.now(UTC), [])
    both = calibrate(
        [*off, *bench.mesh(turns=10, seed=2, calibration=calibration)], bench.motor, bench.sensor
    )
    assert both.delta_epsilon_stderr is not None
    assert abs(both.delta_epsilon - 1.04) < 4 * both.delta_epsilon_stderr
    assert both.delta_epsilon_stderr < 0.01
    wrong = np.abs(first.alpha - gauged(truth.alpha)).max()
    assert np.abs(both.alpha - gauged(truth.alpha)).max() < 0.3 * wrong


@pytest.mark.kernel
def test_sums_over_trials_are_those_of_the_stacked_matrix() -> None:
    """Also where some encoder points of a trial, or all of them, have no sample."""
    rng = np.random.default_rng(8)
    motor = Bench().motor
    k, counts = motor.back_emf_table(), motor.counts
    estimator = ResidualEstimator(motor, (16, 48))
    stacked, torques_Nm = [], []
    for scale in (1.0, 3.0):
        hit = rng.random(counts) < 0.7
        hit[:5] = False
        i_A = scale * 8 * k + rng.normal(size=(counts, 3))
        torque_Nm = rng.normal(size=counts)
        torque_Nm -= torque_Nm[hit].mean()
        estimator.take(Trial(np.vstack([i_A.T, torque_Nm, np.ones(counts)]) * hit))
        stacked.append(np.hstack([i_A * k, k])[hit])
        torques_Nm.append(torque_Nm[hit])
        alone = len(stacked) == 1
        result = estimator.solve()
        assert all((one.stderr_Nm is None) == alone for one in result.harmonics)
        assert [one.name for one in result.findings] == ["one-trial"] * alone
    x, torque_Nm = np.concatenate(stacked), np.concatenate(torques_Nm)
    y, left_Nm = estimator.least_squares()
    assert np.allclose(y, np.linalg.pinv(x) @ torque_Nm, atol=1e-9)
    assert left_Nm.shape == (counts,)
    assert np.isfinite(left_Nm).all()


@pytest.mark.parametrize(("lost", "said"), [(0.0, False), (0.01, False), (0.15, True)])
def test_ticks_that_a_busy_computer_misses_are_named(lost: float, said: bool) -> None:
    """They come in bursts; the intervals are wider for them, and nothing else says why."""
    bench, rng = Bench(), np.random.default_rng(5)
    points = []
    for point in bench.mesh((1.0, 4.0), (0.7, 1.0), turns=6):
        begins = rng.random(point.ticks.size) < lost / 10
        kept = np.convolve(begins, np.ones(10))[: begins.size] == 0
        points.append(replace(point, ticks=point.ticks[kept]))
    result = calibrate(points, bench.motor, bench.sensor)
    notes = [one for one in result.observable if one.startswith("samples: ")]
    assert bool(notes) is said
    assert not said or 10 <= int(notes[0].split()[1]) <= 18
