"""Calibrations of recordings in which a busy computer left gaps of some turns."""

from dataclasses import replace

import numpy as np
import pytest

from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.identification.operating_points import PointData
from tests.support.virtual_calibration import calibrate
from tests.unit.identification.synthetic_bench import Bench

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
