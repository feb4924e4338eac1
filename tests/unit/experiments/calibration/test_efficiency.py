"""Cramer-Rao bound and efficiency: with white noise alone, and with what holds a fit back."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from motord.calibration import CramerRao
from motord.calibration.parts import WHITE_NOISE
from motord.config import TorqueSensorConfig
from motord.experiments.calibration.estimate import efficiency
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.least_squares import scatter
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.identification.operating_points import PointData
from tests.unit.identification.synthetic_bench import Bench, motor

TORQUES_Nm, SPEEDS_Hz = (1.0, 3.0, 5.0), (0.6, 0.9)
NOISE_Nm = 0.05
CURRENT_NOISE_A = 0.05
SEEDS = range(1, 4)


def bench(connection: str, gain_scatter: float = 0.0) -> Bench:
    return Bench(
        motor=motor(connection=connection, counts=2000),
        torque_noise_Nm=NOISE_Nm,
        current_noise_A=CURRENT_NOISE_A,
        drift_Nm=0.0,
        rate_Hz=500,
        fine_Hz=2000,
        sensor=TorqueSensorConfig(highpass_time_constant_s=2.0),
        gain_scatter=gain_scatter,
    )


@cache
def calibrated(
    connection: str, seed: int, gain_scatter: float = 0.0, coloured_Nm: float = 0.0
) -> CalibrationResult:
    of = bench(connection, gain_scatter)
    calibrator = Calibrator(of.motor, of.sensor)
    for point in of.mesh(TORQUES_Nm, SPEEDS_Hz, turns=6.5, seed=seed):
        calibrator.add(with_coloured_noise(point, coloured_Nm, of.rate_Hz, seed))
    return calibrator.joint()


def with_coloured_noise(point: PointData, size_Nm: float, rate_Hz: int, seed: int) -> PointData:
    """Return the point with torque noise below 20 Hz."""
    ticks = point.ticks.copy()
    own = np.random.default_rng([seed, round(10 * point.torque_Nm), round(10 * point.speed_Hz)])
    low = lfilter(*butter(3, 20, fs=rate_Hz), own.standard_normal(ticks.size))
    ticks["torque_Nm"] += size_Nm * low / low.std()
    return replace(point, ticks=ticks)


def bound_of(result: CalibrationResult) -> CramerRao:
    assert result.cramer_rao is not None
    return result.cramer_rao


def shares(found: CramerRao) -> dict[str, float]:
    return {one.source: one.share for one in found.shares}


@pytest.mark.parametrize("connection", ["independent", "star"])
def test_with_white_noise_alone_the_fit_reaches_the_bound(connection: str) -> None:
    """By its stated errors, which few points make a little wide, and by its true ones."""
    results = [calibrated(connection, seed) for seed in SEEDS]
    found = [bound_of(result) for result in results]
    assert 0.6 < 1 / np.mean([1 / one.efficiency for one in found]) < 1.1
    for one in found:
        assert one.white_noise_Nm == pytest.approx(0.0517, rel=0.06)
        assert shares(one)[WHITE_NOISE] > 0.5
        assert sum(shares(one).values()) == pytest.approx(1.0)
    of = bench(connection)
    left = [of.true_rms_percent(T, result) ** 2 for T in TORQUES_Nm for result in results]
    bounds = [one.quantities[-1].bound ** 2 for one in found]
    assert 0.7 < np.mean(left) / np.mean(bounds) < 1.4


def test_what_the_white_noise_is_made_of() -> None:
    """Currents: sum of (alpha_p k_p)^2; encoder: cells of 2 pi / 2000 of what cogging changes."""
    found = bound_of(calibrated("independent", 1))
    truth = bench("independent").truth
    of_currents = CURRENT_NOISE_A * 0.206 / np.sqrt(2) * np.linalg.norm(truth.alpha)
    assert found.current_noise_Nm == pytest.approx(of_currents, rel=0.08)
    slopes = [(order * amplitude) ** 2 / 2 for order, (amplitude, _) in truth.cogging.items()]
    cogging_alone = 2 * np.pi / 2000 / np.sqrt(12) * np.sqrt(sum(slopes))
    assert cogging_alone < found.encoder_noise_Nm < 1.6 * cogging_alone


def test_gains_that_differ_between_points_are_named() -> None:
    found = bound_of(calibrated("independent", 1, gain_scatter=0.01))
    assert found.efficiency < 0.2
    assert found.held_back_by == scatter.POINTS
    assert f"most of the rest: {scatter.POINTS}" in found.to_text()[1]
    assert found.white_noise_Nm == pytest.approx(0.0517, rel=0.06)


def test_coloured_noise_is_named_and_does_not_pass_for_white() -> None:
    found = bound_of(calibrated("independent", 1, coloured_Nm=0.15))
    assert found.efficiency < 0.5
    assert found.held_back_by == efficiency.COLOUR
    assert found.white_noise_Nm == pytest.approx(0.0517, rel=0.15)


def test_what_a_finding_adds_is_named() -> None:
    of = bench("star")
    calibrator = Calibrator(of.motor, of.sensor)
    for point in of.mesh(TORQUES_Nm, SPEEDS_Hz, turns=6.5, seed=2):
        ticks = point.ticks.copy()
        ticks["i_a_A"] += 0.05 * point.ticks["i_b_A"]
        calibrator.add(replace(point, ticks=ticks))
    result = calibrator.joint()
    found = bound_of(result)
    assert "current-sensor-crosstalk" in [one.name for one in result.findings]
    assert found.held_back_by == efficiency.FINDINGS
    assert found.ripple_percent > 50 * found.quantities[-1].bound


def test_noise_taken_from_what_the_model_leaves_hides_its_colour(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The broken twin: the mean square of all orders in place of the high end of the spectrum."""

    def of_all_orders(groups_Nm: np.ndarray, *_: object) -> float:
        apart = groups_Nm - groups_Nm.mean(axis=0)
        return float(np.sqrt((np.abs(apart) ** 2).mean() * 1400 * 6.5 / 12))

    honest = bound_of(calibrated("independent", 1, coloured_Nm=0.15))
    monkeypatch.setattr(efficiency, "floor_Nm", of_all_orders)
    broken = bound_of(calibrated.__wrapped__("independent", 1, 0.0, 0.15))
    assert broken.white_noise_Nm > 1.3 * honest.white_noise_Nm
    assert broken.efficiency > 1.5 * honest.efficiency


def test_quantities_are_those_that_the_calibration_states() -> None:
    names = {c: [one.quantity for one in bound_of(calibrated(c, 1)).quantities] for c in ("star",)}
    result = calibrated("star", 1)
    cogging = [f"cogging order {h.order}" for h in result.harmonics]
    gains = [f"{kind} {phase}" for kind in ("alpha", "beta") for phase in "abc"]
    assert names["star"] == [*gains, "delta epsilon", *cogging, "ripple"]
    without = [one.quantity for one in bound_of(calibrated("independent", 1)).quantities]
    assert "delta epsilon" not in without
