"""Calibrations of recordings in which a busy computer left gaps of some turns."""

from dataclasses import replace

import numpy as np
import pytest

from motord.config import TorqueSensorConfig
from motord.experiments.calibration.estimate.least_squares.normal_equations import Regression
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.calibration.estimate.turn_products import accumulate
from motord.identification.basis import Basis
from motord.identification.harmonics import DAMPED_ROUNDS, DAMPING
from motord.identification.operating_points import PointData, prepare
from motord.identification.orders import SAMPLES_PER_ORDER
from motord.identification.point_ripple import point_ripple
from tests.support.virtual_calibration import calibrate
from tests.unit.identification.synthetic_bench import Bench

PASSES_MEAN = TorqueSensorConfig()

GAPS_TICKS = (3, 4, 5, 5, 8, 10, 15, 22, 45)
"""Of a loop that shared two processors with other work, at 1 kHz."""


def with_gaps(point: PointData, rng: np.random.Generator) -> PointData:
    """Return a point without the samples of some gaps."""
    kept = np.ones(len(point.ticks), bool)
    for gap in GAPS_TICKS:
        first = rng.integers(0, kept.size - gap)
        kept[first : first + gap] = False
    return replace(point, ticks=point.ticks[kept])


def calibrations(seed: int) -> tuple[CalibrationResult, CalibrationResult]:
    """Return the results of a bench with gaps and without."""
    bench, rng = Bench(rate_Hz=1000), np.random.default_rng(seed)
    mesh = bench.mesh((2.0, 5.0), (0.8, 1.0), turns=3.2, seed=seed)
    gaps = [with_gaps(point, rng) for point in mesh]
    return calibrate(gaps, bench.motor, bench.sensor), calibrate(mesh, bench.motor, bench.sensor)


@pytest.mark.parametrize("seed", [1, 11, 19])
def test_gaps_cost_precision_and_no_more(seed: int) -> None:
    gaps, whole = calibrations(seed)
    truth = Bench().truth
    gains = np.array(truth.alpha) / np.cbrt(np.prod(truth.alpha))
    assert np.all(np.abs(gaps.alpha - gains) < 4 * gaps.alpha_stderr)
    assert np.all(np.abs(gaps.beta_A - truth.beta_A) < 4 * gaps.beta_stderr_A)
    for one, other in zip(gaps.ripples, whole.ripples, strict=True):
        assert one.rms_percent == pytest.approx(other.rms_percent, rel=0.1)
    for one, other in zip(gaps.budget, whole.budget, strict=True):
        assert max(one.alpha) < 3 * max(other.alpha) + 1e-4, one.source
        assert one.cogging_Nm < 3 * other.cogging_Nm + 1e-4, one.source
    assert all(quantity.efficiency < 3 for quantity in gaps.cramer_rao.quantities)
    assert not gaps.findings
    assert not gaps.added_orders


def solved_directly(visits: np.ndarray, sums: np.ndarray) -> np.ndarray:
    """Return the lines (h,) of orders 1 to h by the whole matrix, negative orders in it."""
    highest = sums.size - 1
    order = np.arange(-highest, highest + 1)
    apart = order[:, None] - order
    samples = visits[0].real
    seen = np.where(apart < 0, visits[np.abs(apart)].conj(), visits[np.abs(apart)]) / samples
    damping = DAMPING * (order * SAMPLES_PER_ORDER / samples) ** 2
    wanted = np.concatenate([sums[:0:-1].conj(), sums]) / samples
    lines = np.zeros_like(wanted)
    for _ in range(DAMPED_ROUNDS):
        lines += np.linalg.solve(seen + np.diag(damping), wanted - seen @ lines)
    return 2 * lines[highest + 1 :]


@pytest.mark.parametrize("seed", [2, 4])
def test_a_mean_torque_does_not_decide_what_is_left_over_a_turn_with_gaps(seed: int) -> None:
    bench = Bench(sensor=PASSES_MEAN, torque_noise_Nm=0.005, drift_Nm=0.0, speed_ripple=0.0)
    point = with_gaps(bench.point(5.0, 1.0, 3.2, seed), np.random.default_rng(seed))
    basis = Basis.of(bench.motor, tuple(bench.truth.cogging))
    products = accumulate(prepare(point, bench.motor.counts), basis, bench.sensor)
    regression = Regression([products], basis, len(basis.orders), kirchhoff=False)
    waves = [
        a * part(phase) for a, phase in bench.truth.cogging.values() for part in (np.sin, np.cos)
    ]
    theta = np.array([*bench.truth.alpha, *bench.truth.beta_A, 0.0, 0.0, *waves])
    coefficients, spectrum = regression.coefficients(theta), products.spectrum
    sums = spectrum.sums[:, :, -1] - spectrum.sums[:, :, :-1] @ coefficients
    wanted = [solved_directly(*one) for one in zip(spectrum.visits, sums, strict=True)]
    assert np.abs(spectrum.residual(coefficients) - wanted).max() < 1e-4


@pytest.mark.parametrize("mean_Nm", [5.0, 20.0])
def test_a_mean_torque_has_no_part_in_the_ripple_of_turns_with_gaps(mean_Nm: float) -> None:
    bench = Bench(sensor=PASSES_MEAN)
    point = with_gaps(bench.point(2.0, 1.0, 2.2, 3), np.random.default_rng(3))
    samples = prepare(point, bench.motor.counts)
    more = replace(samples, torque_Nm=samples.torque_Nm + mean_Nm)
    here, there = (point_ripple(one, bench.motor, bench.sensor) for one in (samples, more))
    assert there.rms_percent == pytest.approx(here.rms_percent, rel=1e-5)
    assert there.mean_Nm == pytest.approx(here.mean_Nm + mean_Nm)
